"""``pipeline.yaml``: its fields, and the parameters of every stage resolved as base ← profile ← --set."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from hqpipe.errors import ConfigError, UsageError, near_match, shown
from hqpipe.pipeline.complaints import ConfigErrors, FieldError, file_errors, section_errors
from hqpipe.pipeline.names import path_problem
from hqpipe.pipeline.options import MAX_WORKERS
from hqpipe.pipeline.overrides import Origin, Override, lay_over, parse_override
from hqpipe.pipeline.stage import Stage, StageTable
from hqpipe.pipeline.yaml_source import Location, YamlSource, read_yaml

__all__ = ["FILE", "Configuration", "FieldError", "Settings", "StageParams", "StageSettings"]

FILE = "pipeline.yaml"
ROBOT = "robot"
"""Key of the robot's folder in the context of a validation (`pydantic.ValidationInfo`), where it is known."""


class StageParams(BaseModel):
    """Base of every stage's ``Params``: frozen, no unknown field, no NaN or inf, no true for 1. ``seed`` is no parameter."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True, strict=True)


def _workers(value: Any) -> int | str:
    number = isinstance(value, int) and not isinstance(value, bool)
    if value == "auto" or (number and 1 <= value <= MAX_WORKERS):
        return value
    raise ValueError(f"expected 'auto' or a number of processes from 1 to {MAX_WORKERS}, got {shown(value)}")


def _path(value: str) -> str:
    if problem := path_problem(value):
        raise ValueError(problem)
    return value


Section = Annotated[dict[str, Any], BeforeValidator(lambda value: {} if value is None else value)]
"""Parameters of one stage; an empty section reads as no parameters."""

# NumPy and PyTorch both take seeds of 32 bits.
Seed = Annotated[int, Field(ge=0, lt=2**32, strict=True)]


class _Seeded(BaseModel):
    seed: Seed


class _File(BaseModel):
    """The fields at the top of ``pipeline.yaml``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Annotated[str, AfterValidator(_path)]
    seed: Seed = 1
    profile: str = "default"
    workers: Annotated[Any, AfterValidator(_workers)] = "auto"
    artifacts: Annotated[str, AfterValidator(_path)] = "artifacts"
    stages: dict[str, Section] = {}
    profiles: dict[str, Annotated[dict[str, Section], BeforeValidator(lambda v: {} if v is None else v)]] = {
        "default": {}
    }


@dataclass(frozen=True)
class StageSettings:
    """One stage's resolved parameters and seed."""

    params: StageParams
    seed: int


@dataclass(frozen=True)
class Settings:
    """Everything resolved: what a run uses.

    Args:
        robot: name or path, as written.
        artifacts: folder, relative to the project root.
        workers: number of processes.
        profile: name of the profile.
        stages: stage name → its settings.
    """

    robot: str
    artifacts: str
    workers: int
    profile: str
    stages: dict[str, StageSettings]


class Configuration:
    """A checked ``pipeline.yaml``, before a profile is chosen.

    Args:
        path: the file.
        table: the stages that may have a section.

    Raises:
        ConfigError: unknown field or section, or a value of the wrong kind.
    """

    def __init__(self, path: Path, table: StageTable) -> None:
        self._sections = sorted({stage.section for stage in table.values()})
        self._source: YamlSource = read_yaml(path)
        try:
            self.file = _File.model_validate(self._source.data)
        except ValidationError as error:
            raise file_errors(error, self._source, _File) from None
        for above, sections in self._all_sections():
            for section in sections:
                if section not in self._sections:
                    place, name = (*above, section), section[:80]
                    message = f"unknown stage '{name}'{near_match(name, self._sections)}"
                    raise self._error(place, f"{message} (known: {', '.join(self._sections)})", "rename or remove it")

    def _all_sections(self) -> Iterable[tuple[Location, dict[str, Any]]]:
        yield ("stages",), self.file.stages
        for name, sections in self.file.profiles.items():
            yield ("profiles", name), sections

    def _error(self, place: Location, message: str, fix: str) -> ConfigError:
        name = ".".join(place)
        return ConfigError(
            f"{self._source.where(place)}: {name}: {message}", file=self._source.path, field=name, fix=fix
        )

    def resolve(
        self,
        stages: Iterable[Stage],
        *,
        profile: str | None = None,
        overrides: Iterable[str | Override] = (),
        seed: int | None = None,
        robot: Path | None = None,
    ) -> Settings:
        """Merge base ← profile ← overrides and validate the sections of `stages`.

        The sections of the other profiles, and those of the base alone, are checked too, so that a wrong value does not
        wait for the day on which nothing hides it any more.

        Args:
            stages: the stages whose parameters are wanted.
            profile: instead of the file's ``profile``.
            overrides: ``"stage.key=value"`` each, the value read as YAML; or parsed already.
            seed: instead of the file's ``seed``; a seed inside a section is kept.
            robot: its folder, for parameters that name parts of it; without it these names are not checked.

        Raises:
            ConfigError: fields are unknown or have wrong values; all of them are named.
            UsageError: an override is not of that form, or the profile is unknown.
        """
        profile = self._known_profile(profile)
        parsed = [o if isinstance(o, Override) else parse_override(o, self._sections) for o in overrides]
        base_seed = (
            self.file.seed if seed is None else _check_seed(seed, Origin("--seed", None, "--seed", "give another"))
        )
        resolved, wrong = {}, {}
        for stage in stages:
            for layers, changes in self._layerings(stage, profile, parsed):
                try:
                    resolved[stage.name] = self._settings(stage, layers, changes, base_seed, robot)
                except ConfigErrors as error:
                    wrong |= {str(each): each for each in error.errors}
        if wrong:
            raise ConfigErrors(list(wrong.values()))
        workers = self.file.workers
        return Settings(
            robot=self.file.robot,
            artifacts=self.file.artifacts,
            workers=workers if isinstance(workers, int) else len(os.sched_getaffinity(0)),
            profile=profile,
            stages=resolved,
        )

    def _known_profile(self, profile: str | None) -> str:
        """The profile to use; the file's own is checked even where another is asked for."""
        known = ", ".join(self.file.profiles)
        if self.file.profile not in self.file.profiles:
            name = self.file.profile[:80]
            message = f"unknown profile '{name}'{near_match(name, self.file.profiles)} (known: {known})"
            raise self._error(("profile",), message, "name one of these, or add it under profiles")
        if profile is None or profile in self.file.profiles:
            return self.file.profile if profile is None else profile
        name = profile[:80]
        message = f"{FILE}: unknown profile '{name}'{near_match(name, self.file.profiles)} (known: {known})"
        raise UsageError(message, file=self._source.path, field="--profile", fix="name one of these")

    def _layerings(
        self, stage: Stage, profile: str, overrides: Sequence[Override]
    ) -> Iterable[tuple[list[Location], list[Override]]]:
        """The layers to be validated together, those that are used last: the base, it under each profile, and with --set."""
        base: Location = ("stages",)
        yield [base], []
        for name, sections in self.file.profiles.items():
            if stage.section in sections and name != profile:
                yield [base, ("profiles", name)], []
        changes = [override for override in overrides if override.section == stage.section]
        if changes:
            yield [base, ("profiles", profile)], []
        yield [base, ("profiles", profile)], changes

    def _settings(
        self, stage: Stage, layers: Sequence[Location], overrides: Sequence[Override], seed: int, robot: Path | None
    ) -> StageSettings:
        """Merge and validate one stage's section."""
        merged: dict[str, Any] = {}
        origins: dict[Location, Origin] = {}
        for above in layers:
            sections = self.file.stages if above == ("stages",) else self.file.profiles[above[1]]
            where = (*above, stage.section)
            lay_over(
                merged, sections.get(stage.section, {}), (), lambda path, at=where: self._origin((*at, *path)), origins
            )
        for override in overrides:
            lay_over(merged, override.values, (), override.origin, origins)
        if "seed" in merged:
            seed = _check_seed(merged.pop("seed"), origins[("seed",)])
        params_class = stage.load_params()
        try:
            return StageSettings(params_class.model_validate(merged, context={ROBOT: robot}), seed)
        except ValidationError as error:
            base = self._origin(("stages", stage.section))
            raise section_errors(error, origins, params_class, stage, base) from None

    def _origin(self, location: Location) -> Origin:
        name = ".".join(location)
        where = f"{self._source.where(location)}: {name}"
        return Origin(where, str(self._source.path), name, "correct the value")


def _check_seed(value: Any, origin: Origin) -> int:
    try:
        return _Seeded(seed=value).seed
    except ValidationError:
        message = f"{origin.text}: expected a whole number from 0 to 2³² − 1, got {shown(value)}"
        raise ConfigErrors([ConfigError(message, file=origin.file, field=origin.field, fix=origin.fix)]) from None
