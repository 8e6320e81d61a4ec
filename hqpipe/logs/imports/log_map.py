"""What a mapping file says: which field is which channel, in which unit, on which clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hqpipe.logs.columns import joint_column
from hqpipe.logs.imports.units import Unit, slides
from hqpipe.logs.joint_kinds import PRISMATIC


@dataclass(frozen=True)
class Term:
    """One field: value = sign × scale × unit(raw − zero) + offset.

    Attributes:
        names: of the field; the first one that a recording has is taken.
        unit: None for the one that the file states, else SI. unit_name: as written.
        zero: raw reading that means 0. offset: in the unit of the channel.
    """

    names: tuple[str, ...]
    unit: Unit | None = None
    unit_name: str = ""
    sign: float = 1.0
    scale: float | None = None
    zero: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True)
class Source:
    """Where a column comes from: the sum of `terms`, plus `offset`; with `integral` a position, the integral of that from 0."""

    terms: tuple[Term, ...]
    offset: float = 0.0
    integral: bool = False


@dataclass(frozen=True)
class ClockSource:
    """A clock: `field` of its stream, None for the stream's own time; `factor` makes it seconds.

    `stream` is the one whose clock the trial keeps, None for that of the effort, else of the position.
    `rows_hz` is given where no clock was recorded: the rows came at this steady rate.
    """

    field: str | None = None
    factor: float | None = None
    stream: str | None = None
    rows_hz: float | None = None


@dataclass(frozen=True)
class TrialRule:
    """What is stated for the files that one of `files` matches."""

    files: tuple[str, ...]
    split: str | None = None
    command: dict[str, float] | None = None
    base: str | None = None
    drive: dict[str, dict[str, float]] = field(default_factory=dict)
    load: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class LogMap:
    """A mapping file.

    Attributes:
        sources: full column name → where it comes from.
        kinds: joint → type, of those whose type is stated.
        clock, clocks: for all streams, and stream → its own.
        trials: rules, the first that matches a file counts. drive, load: joint → quantity → value, of all trials.
        join: how the files that make one trial together are named, None where a file is a trial.
        robot, base, control_mode, effort_source, rate_hz: as in logset.yaml.
    """

    path: Path
    sources: Mapping[str, Source]
    kinds: Mapping[str, str] = field(default_factory=dict)
    clock: ClockSource = ClockSource()
    clocks: Mapping[str, ClockSource] = field(default_factory=dict)
    trials: tuple[TrialRule, ...] = ()
    drive: dict[str, dict[str, float]] = field(default_factory=dict)
    load: dict[str, dict[str, float]] = field(default_factory=dict)
    join: str | None = None
    robot: str | None = None
    base: str | None = None
    control_mode: str | None = None
    effort_source: str | None = None
    rate_hz: float | None = None

    def sliding(self, joint: str) -> bool | None:
        """Whether a joint slides, by its type or the units of its channels; None where they do not say it."""
        if joint in self.kinds:
            return self.kinds[joint] == PRISMATIC
        own = {name: source for name, source in self.sources.items() if name.startswith(joint_column(joint, ""))}
        said = sliding_by_units(own.values()) or sliding_by_units([own[joint_column(joint, "position")]], scaled=True)
        return said.pop() if said else None


def sliding_by_units(sources: Iterable[Source], *, scaled: bool = False) -> set[bool]:
    """Whether a joint slides, by every unit that says it: empty where none does, both where they contradict each other.

    A scale may make another quantity of what was recorded, as a lever makes a torque of N, so that units with one count only
    if `scaled`.
    """
    terms = [t for source in sources for t in source.terms if t.unit and (scaled or t.scale is None)]
    return {slides(t.unit.kind) for t in terms} - {None}
