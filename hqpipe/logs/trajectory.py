"""Trials in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hqpipe.errors import LogError, near_match
from hqpipe.logs.columns import CHANNELS, TIME, RawTable, joint_column
from hqpipe.logs.drive import Stated
from hqpipe.logs.findings import Finding


@dataclass(frozen=True)
class Excerpt:
    """Where a section lies in the trial that it was cut from.

    Attributes:
        recording: file of the trial. start: s from the start of the trial. whole: s, length of the trial.
    """

    recording: str
    start: float
    whole: float


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One trial on its own clock; float64, SI units.

    Attributes:
        time: (T,) s, strictly increasing from 0.
        joints: J names, the order of the columns below.
        position, velocity: (T, J) rad, rad/s (m, m/s for a prismatic joint).
        effort: (T, J) measured torque, N·m (N), or None if not recorded; likewise the commands, the current in A, the duty of
            the drive −1 … 1, and the pressures in Pa.
        extra: every other column under its full name, (T,).
        velocity_source: "measured" or "differentiated" (zero-phase, from position).
        excerpt: where it lies in the recorded trial, if it is a section of one; its own clock starts at 0 too.
        observed: (T, J) False where a measured value of the joint was not recorded but interpolated: such a sample is no
            evidence for or against a model. None where all were recorded.
    """

    time: np.ndarray
    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray | None = None
    position_command: np.ndarray | None = None
    effort_command: np.ndarray | None = None
    valve_command: np.ndarray | None = None
    current: np.ndarray | None = None
    duty: np.ndarray | None = None
    pressure_a: np.ndarray | None = None
    pressure_b: np.ndarray | None = None
    extra: Mapping[str, np.ndarray] = field(default_factory=dict)
    velocity_source: str = "measured"
    excerpt: Excerpt | None = None
    observed: np.ndarray | None = None

    @property
    def samples(self) -> int:
        return len(self.time)

    @property
    def dt(self) -> float:
        """Median sample time, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """s, from the first sample to the last."""
        return float(self.time[-1] - self.time[0])

    @property
    def start(self) -> float:
        """s from the start of the recorded trial to the first sample."""
        return self.excerpt.start if self.excerpt else 0.0

    @property
    def whole(self) -> float:
        """Length of the recorded trial, s."""
        return self.excerpt.whole if self.excerpt else self.duration

    @property
    def recorded(self) -> np.ndarray:
        """(T, J) whether the measured values of a joint were recorded, see `observed`."""
        return np.ones(self.position.shape, dtype=bool) if self.observed is None else self.observed

    def channels(self) -> dict[str, np.ndarray]:
        """The recorded (T, J) channels by name, in the order of the format."""
        present = {name: getattr(self, name) for name in CHANNELS}
        return {name: values for name, values in present.items() if values is not None}

    def joint(self, name: str) -> int:
        """Column of a joint.

        Raises:
            LogError: no such joint.
        """
        if name not in self.joints:
            raise LogError(
                f"no joint '{name}'{near_match(name, self.joints)} (has {', '.join(self.joints)})",
                field=name,
                fix="name one of these joints, or record the joint",
            )
        return self.joints.index(name)

    def for_joints(self, joints: Sequence[str]) -> Trajectory:
        """The same trial with its joints in the given order (or fewer of them)."""
        rows = [self.joint(name) for name in joints]
        moved = {name: np.ascontiguousarray(values[:, rows]) for name, values in self.channels().items()}
        observed = None if self.observed is None else np.ascontiguousarray(self.observed[:, rows])
        return replace(self, joints=tuple(joints), observed=observed, **moved)

    def section(self, start: int, stop: int) -> Trajectory:
        """Samples start … stop − 1 as a trial of their own, with its clock at 0."""
        cut = {name: values[start:stop] for name, values in self.channels().items()}
        extra = {name: values[start:stop] for name, values in self.extra.items()}
        time = self.time[start:stop] - self.time[start]
        observed = None if self.observed is None else self.observed[start:stop]
        return replace(self, time=time, extra=extra, excerpt=None, observed=observed, **cut)

    def columns(self) -> dict[str, np.ndarray]:
        """Flat columns under the names of the format; a differentiated velocity is left out."""
        flat = {TIME: self.time}
        channels = self.channels()
        if self.velocity_source == "differentiated":
            del channels["velocity"]
        for j, joint in enumerate(self.joints):
            flat.update({joint_column(joint, name): values[:, j] for name, values in channels.items()})
        return flat | dict(self.extra)


@dataclass(frozen=True, eq=False)
class Trial:
    """A trajectory and its part in the log set: `split` is "fit" or "heldout", `base` "floating" or "fixed".

    `drive` and `load` are what is stated of its joints, see `hqpipe.logs.drive`.
    """

    file: str
    split: str
    command: dict[str, float] | None
    trajectory: Trajectory
    base: str | None = None
    drive: Stated = field(default_factory=dict)
    load: Stated = field(default_factory=dict)

    def table(self, folder: Path) -> RawTable:
        """Its columns, as if read from the folder of its log set."""
        return RawTable(folder / self.file, self.trajectory.columns())


class Recorded(Protocol):
    """A trial, or what was made of one."""

    @property
    def file(self) -> str: ...

    @property
    def trajectory(self) -> Trajectory: ...


def recording_of(item: Recorded) -> str:
    """File of the recorded trial, of which `item` may be a section."""
    return item.trajectory.excerpt.recording if item.trajectory.excerpt else item.file


@dataclass(frozen=True)
class Repair:
    """What was done to logs so that they can be used, or left out of them.

    Attributes:
        kind: "missing", "repeated", "jitter", "rates", "channel", "joint" or "trial" (the last three were left out).
        text: a line for a person. trials: files concerned. column: name, or "<name>" for the joint where all have it; "" if it
            concerns the clock. share: of the samples, where that is a number.
    """

    kind: str
    text: str
    trials: tuple[str, ...]
    column: str = ""
    share: float = 0.0


@dataclass(frozen=True)
class AsRecorded:
    """A file, or a section of one, before its repair.

    Attributes:
        rows: in it. rate_hz: of rows that follow each other. jitter_rms, jitter_max: of their steps, shares of a sample.
        lost: rows that are missing by the clock. gaps: places where they are.
        repeated: rows that bore the time of the one before. stretches: into which it was cut.
        missing: share of the values that are missing or without physical sense.
    """

    rows: int
    rate_hz: float
    jitter_rms: float
    jitter_max: float
    lost: int
    gaps: int
    repeated: int
    missing: float
    stretches: int


@dataclass(frozen=True, eq=False)
class LogSet:
    """Trials of one machine with the same joints.

    Attributes:
        path: the directory. sha256: over the names and bytes of its files.
        robot: name or URDF path, or None. base: of every trial that does not say otherwise. control_mode: "position",
            "torque", "valve" or None if no command was recorded. effort_source: "pressure", "load_cell",
            "current", "estimate" or None.
        rate_hz: nominal sample rate.
        kinds: joint → "revolute" or "prismatic"; empty where nobody says, see `hqpipe.logs.joint_kinds`.
        warnings: what looks wrong but is not certain to be, and what was repaired or left out.
        findings: of what looks wrong, those that concern single trials. repairs: what was repaired or left out.
        as_recorded: file, or name of a section that was read of it → before its repair.
    """

    path: Path
    sha256: str
    format: str
    robot: str | None
    base: str | None
    control_mode: str | None
    effort_source: str | None
    rate_hz: float
    joints: tuple[str, ...]
    trials: tuple[Trial, ...]
    warnings: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    repairs: tuple[Repair, ...] = ()
    as_recorded: Mapping[str, AsRecorded] = field(default_factory=dict)
    kinds: Mapping[str, str] = field(default_factory=dict)

    @property
    def fit(self) -> list[Trial]:
        return [trial for trial in self.trials if trial.split == "fit"]

    @property
    def heldout(self) -> list[Trial]:
        return [trial for trial in self.trials if trial.split == "heldout"]

    def header(self) -> dict[str, Any]:
        """Everything but the trials, JSON-able."""
        apart = ("trials", "findings", "repairs", "as_recorded")
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in apart}
        return plain | {
            "path": str(self.path),
            "joints": list(self.joints),
            "warnings": list(self.warnings),
        }
