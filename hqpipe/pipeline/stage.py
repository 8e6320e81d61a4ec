"""What a stage is, before anything of it is imported: the rows of the STAGES table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from hqpipe.errors import UsageError, near_match
from hqpipe.pipeline.hashing import data_hash
from hqpipe.registry import load


@dataclass(frozen=True)
class Input:
    """One folder that a stage reads.

    Args:
        name: key in ``context.inputs``.
        artifact: the artifact that is read when no folder is given; None where the stage then does without.
        option: command-line option that names a folder instead, e.g. ``"--logs"``.
        optional: the stage does without it where it has not been made, and where the user names other inputs but
            not this one.
        help: of the option; None for what is said of every artifact.
        files: names of all files in it that the stage reads, where those are not all of them: it is not run again when
            others change. A name that is not there says nothing.
        also: further spellings of `option`, which are accepted and not shown.
    """

    name: str
    artifact: str | None
    option: str
    optional: bool = False
    help: str | None = None
    files: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    def content(self, outputs: Mapping[str, str]) -> str:
        """Hash over what the stage reads of a folder.

        Args:
            outputs: relative path → SHA-256 of every file in the folder.
        """
        read = {name: outputs[name] for name in self.files if name in outputs} if self.files else dict(outputs)
        return data_hash(read)


@dataclass(frozen=True)
class Stage:
    """One step of the chain.

    Args:
        name: what is typed, e.g. ``"fit-actuator"``.
        artifact: the folder under ``artifacts/`` that it makes.
        module: module with ``run(context) -> metrics`` and ``Params``, a ``StageParams`` with a default for
            every field; imported only when the stage is used.
        help: one line.
        version: raise it when the code changes what the stage produces, so that old results are made again.
        inputs: the folders that it reads.
        flags: options that are accepted and change nothing, e.g. the only export format, as (option, help).
        switches: options that set a parameter of the same name to true, as (option, help).
        settings: options that set a parameter of the same name to a value, as (option, name of the value, help).
        alone: whether it runs by its own name only, and not in ``hqpipe run all``.
    """

    name: str
    artifact: str
    module: str
    help: str
    version: int = 1
    inputs: tuple[Input, ...] = ()
    flags: tuple[tuple[str, str], ...] = ()
    switches: tuple[tuple[str, str], ...] = ()
    settings: tuple[tuple[str, str, str], ...] = ()
    alone: bool = False

    @property
    def section(self) -> str:
        """The stage's key in ``pipeline.yaml``."""
        return self.name.replace("-", "_")

    @staticmethod
    def parameter(option: str) -> str:
        """The parameter that an option of `switches` or `settings` sets."""
        return option.removeprefix("--").replace("-", "_")

    def load_run(self):
        """Import the stage's ``run(context)``."""
        return load(f"{self.module}:run")

    def load_params(self):
        """Import the stage's ``Params`` class."""
        return load(f"{self.module}:Params")


class StageTable(Mapping[str, Stage]):
    """The stages by name, in the order in which the chain runs; those that run alone last.

    Args:
        stages: each after the stages whose artifacts it reads.
        template: the ``pipeline.yaml`` that ``hqpipe init`` writes.
        robot_check: ``"module:function"`` that refuses a robot before a stage starts: (its folder, names of the stages).
    """

    def __init__(self, stages: Iterable[Stage], template: Path, robot_check: str | None = None) -> None:
        self.template = template
        self._robot_check = robot_check
        self._stages: dict[str, Stage] = {}
        self._makers: dict[str, Stage] = {}
        for stage in stages:
            for needed in stage.inputs:
                if needed.artifact is not None and needed.artifact not in self._makers:
                    raise ValueError(f"stage '{stage.name}': no earlier stage makes '{needed.artifact}'")
            if stage.name in self._stages or stage.artifact in self._makers:
                raise ValueError(f"stage '{stage.name}': name or artifact '{stage.artifact}' is taken")
            self._stages[stage.name] = stage
            self._makers[stage.artifact] = stage

    def __getitem__(self, name: str) -> Stage:
        if name not in self._stages:
            known = ", ".join(self._stages)
            text = f"unknown stage '{name[:80]}'{near_match(name[:80], self._stages)} (known: {known})"
            raise UsageError(text, field="stage", fix="name one of these")
        return self._stages[name]

    def __contains__(self, name: object) -> bool:
        return name in self._stages

    def __iter__(self) -> Iterator[str]:
        return iter(self._stages)

    def __len__(self) -> int:
        return len(self._stages)

    @property
    def artifacts(self) -> tuple[str, ...]:
        """Names of the artifacts, in the order in which they are made."""
        return tuple(self._makers)

    def check_robot(self, folder: Path, stages: Iterable[Stage]) -> None:
        """Refuse a robot that `stages` cannot work with, as far as that is known before they start.

        Raises:
            ConfigError: names the file and the field of the robot.
        """
        if self._robot_check is not None:
            load(self._robot_check)(folder, [stage.name for stage in stages])

    def maker(self, artifact: str) -> Stage:
        """The stage that makes `artifact`."""
        return self._makers[artifact]

    def between(self, first: str | None, last: str | None) -> list[Stage]:
        """The stages of the chain from `first` to `last`, both included; None means its end on that side."""
        names = [name for name, stage in self._stages.items() if not stage.alone]
        for option, name in (("--from", first), ("--until", last)):
            if name is not None and name not in names:
                if name not in self:
                    text = f"{option}: unknown stage '{name[:80]}'{near_match(name[:80], names)}"
                    raise UsageError(f"{text} (known: {', '.join(names)})", field=option, fix="name one of these")
                fix = f"run it as `hqpipe {name}`"
                raise UsageError(f"{option}: '{name}' is no part of the chain", field=option, fix=fix)
        start = names.index(first) if first else 0
        stop = names.index(last) if last else len(names) - 1
        if start > stop:
            text = f"--from {first} comes after --until {last}"
            raise UsageError(text, field="--from", fix=f"give stages in this order: {', '.join(names)}")
        return [self[name] for name in names[start : stop + 1]]
