"""``pipeline.yaml``: its fields, and the parameters of every stage resolved as base ← profile ← --set."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from hqpipe.errors import ConfigError, UsageError, near_match
from hqpipe.pipeline.stage import Stage, StageTable
from hqpipe.pipeline.yaml_source import Location, YamlSource, read_yaml

FILE = "pipeline.yaml"


class StageParams(BaseModel):
    """Base of every stage's ``Params``: frozen, no unknown field, no NaN or inf. ``seed`` is no parameter."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, validate_default=True)


def _workers(value: int | str) -> int | str:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise ValueError(f"expected 'auto' or a number of processes from 1, got {value!r}")


Section = Annotated[dict[str, Any], BeforeValidator(lambda value: {} if value is None else value)]
"""Parameters of one stage; an empty section reads as no parameters."""

# NumPy and PyTorch both take seeds of 32 bits.
Seed = Annotated[int, Field(ge=0, lt=2**32, strict=True)]


class _Seeded(BaseModel):
    seed: Seed


class _File(BaseModel):
    """The fields at the top of ``pipeline.yaml``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: str
    seed: Seed = 1
    profile: str = "default"
    workers: Annotated[int | str, AfterValidator(_workers)] = "auto"
    artifacts: str = "artifacts"
    stages: dict[str, Section] = {}
    profiles: dict[str, Annotated[dict[str, Section], BeforeValidator(lambda v: v or {})]] = {"default": {}}


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
        self._table = table
        self._source: YamlSource = read_yaml(path)
        try:
            self.file = _File.model_validate(self._source.data)
        except ValidationError as error:
            lines = [_describe(item, self._source, (), _File) for item in error.errors()]
            raise ConfigError("\n".join(lines)) from None
        known = {stage.section for stage in table.values()}
        for above, sections in self._all_sections():
            for section in sections:
                if section not in known:
                    where = self._source.where((*above, section))
                    names = ", ".join(sorted(known))
                    hint = near_match(section, known)
                    raise ConfigError(f"{where}: {'.'.join(above)}: unknown stage '{section}'{hint} (known: {names})")

    def _all_sections(self) -> Iterable[tuple[Location, dict[str, Any]]]:
        yield ("stages",), self.file.stages
        for name, sections in self.file.profiles.items():
            yield ("profiles", name), sections

    def resolve(
        self,
        stages: Iterable[Stage],
        *,
        profile: str | None = None,
        overrides: Iterable[str] = (),
        seed: int | None = None,
    ) -> Settings:
        """Merge base ← profile ← overrides and validate the sections of `stages`.

        Args:
            stages: the stages whose parameters are wanted.
            profile: instead of the file's ``profile``.
            overrides: ``"stage.key=value"`` each, the value read as YAML.
            seed: instead of the file's ``seed``; a seed inside a section is kept.

        Raises:
            ConfigError: a field is unknown or has the wrong value.
            UsageError: an override is not of that form, or the profile is unknown.
        """
        profile = self.file.profile if profile is None else profile
        if profile not in self.file.profiles:
            known = ", ".join(self.file.profiles)
            hint = near_match(profile, self.file.profiles)
            raise UsageError(f"{FILE}: unknown profile '{profile}'{hint} (known: {known})")
        parsed = [_parse_override(text, self._table) for text in overrides]
        base_seed = self.file.seed if seed is None else _check_seed(seed, "--seed")
        workers = self.file.workers
        return Settings(
            robot=self.file.robot,
            artifacts=self.file.artifacts,
            workers=workers if isinstance(workers, int) else len(os.sched_getaffinity(0)),
            profile=profile,
            stages={stage.name: self._settings(stage, profile, parsed, base_seed) for stage in stages},
        )

    def _settings(self, stage: Stage, profile: str, overrides: list[_Override], seed: int) -> StageSettings:
        """Resolve and validate one stage's section."""
        merged: dict[str, Any] = {}
        origins: dict[Location, str] = {}
        layers = [
            (("stages",), self.file.stages.get(stage.section, {})),
            (("profiles", profile), self.file.profiles[profile].get(stage.section, {})),
        ]
        for above, values in layers:
            where = (*above, stage.section)
            _merge(merged, values, (), lambda path, where=where: self._origin((*where, *path)), origins)
        for override in overrides:
            if override.section == stage.section:
                _merge(merged, override.values, (), lambda path, text=override.text: f"--set {text}", origins)
        if "seed" in merged:
            seed = _check_seed(merged.pop("seed"), origins[("seed",)])
        params_class = stage.load_params()
        try:
            return StageSettings(params_class.model_validate(merged), seed)
        except ValidationError as error:
            base = self._origin(("stages", stage.section))
            lines = [_describe_param(item, origins, params_class, stage, base) for item in error.errors()]
            raise ConfigError("\n".join(lines)) from None

    def _origin(self, location: Location) -> str:
        return f"{self._source.where(location)}: {'.'.join(location)}"


@dataclass(frozen=True)
class _Override:
    section: str
    values: dict[str, Any]
    text: str


def _parse_override(text: str, table: StageTable) -> _Override:
    """Read ``stage.key=value``; deeper keys are separated by further dots."""
    name, equals, value = text.partition("=")
    section, *keys = name.strip().split(".")
    section = section.replace("-", "_")
    known = {stage.section for stage in table.values()}
    if not equals or not keys or not all(keys):
        raise UsageError(f"--set {text}: expected stage.key=value, e.g. --set {min(known)}.seed=3")
    if section not in known:
        names = ", ".join(sorted(known))
        raise UsageError(f"--set {text}: unknown stage '{section}'{near_match(section, known)} (known: {names})")
    try:
        values = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise UsageError(f"--set {text}: the value is not valid YAML") from error
    for key in reversed(keys):
        values = {key: values}
    return _Override(section, values, text)


def _merge(into: dict, values: dict, above: Location, origin, origins: dict[Location, str]) -> None:
    """Lay `values` over `into`, mapping by mapping, noting in `origins` where each field came from."""
    for key, value in values.items():
        path = (*above, str(key))
        origins[path] = origin(path)
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value, path, origin, origins)
        elif isinstance(value, dict):
            into[key] = {}
            _merge(into[key], value, path, origin, origins)
        else:
            into[key] = value


def _check_seed(value: Any, origin: str) -> int:
    try:
        return _Seeded(seed=value).seed
    except ValidationError:
        raise ConfigError(f"{origin}: expected a whole number from 0 to 2³² − 1, got {value!r}") from None


def _expectation(item: Any) -> str:
    """Pydantic's message in our words: what was expected, and what was found."""
    if item["type"] == "value_error":
        return str(item["ctx"]["error"])
    message = item["msg"].replace("Input should be ", "expected ").replace("Input should ", "expected to ")
    return f"{message}, got {item['input']!r}"


def _fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Names of the fields of the (nested) model at `location`; empty if there is no model there."""
    for name in location:
        field = model.model_fields.get(name)
        if field is None or not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)):
            return []
        model = field.annotation
    return list(model.model_fields)


def _complaint(item: Any, location: Location, model: type[BaseModel], kind: str) -> str:
    """What is wrong with the field at `location`."""
    if item["type"] == "extra_forbidden":
        known = _fields_at(model, location[:-1])
        return f"unknown {kind} '{location[-1]}'{near_match(location[-1], known)} (known: {', '.join(known)})"
    if item["type"] == "missing":
        return f"{kind} '{location[-1]}' is missing"
    return _expectation(item)


def _describe(item: Any, source: YamlSource, above: Location, model: type[BaseModel]) -> str:
    """One line for an error in the fields at the top of the file."""
    location = (*above, *(str(part) for part in item["loc"]))
    return f"{source.where(location)}: {'.'.join(location)}: {_complaint(item, location, model, 'field')}"


def _describe_param(item: Any, origins: dict[Location, str], model: type[BaseModel], stage: Stage, base: str) -> str:
    """One line for an error in a stage's parameters, naming the layer that set the value."""
    location = tuple(str(part) for part in item["loc"])
    depth = next((n for n in range(len(location), 0, -1) if location[:n] in origins), 0)
    origin = origins[location[:depth]] if depth else base
    return f"{origin}: {_complaint(item, location, model, f'parameter of {stage.name}')}"
