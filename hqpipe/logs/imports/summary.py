"""What an import made: trials, ranges, what was left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.columns import TIME, joint_column, joints_of
from hqpipe.logs.imports.clock import regularity
from hqpipe.logs.imports.log_map import LogMap
from hqpipe.logs.imports.units import KINDS, kinds_of, slides

_OUTLIER = 5.0  # times the usual size; assumption: motions differ by less, units (cm, mm, deg) by more
_STRIDES = 400  # in a trial; assumption: enough for a slope, and each longer than the noise of an encoder
_CORRELATED, _SLOPES = 0.8, (0.75, 1.33)  # assumption: as for the units of a log set
_LEAST_POINTS = 20  # that a slope is taken from
_LEAST_TRIALS = 4  # that tell what is usual


@dataclass(frozen=True, eq=False)
class TrialSummary:
    """One trial.

    Attributes:
        file: in the log set. source: file that it comes from. split: "fit" or "heldout".
        gaps: steps of more than four median ones, longest_s the longest step.
        ranges: column → smallest and largest value. missing: column → samples without a value.
        notes: on reading and converting it.
        agreeing: positions and velocities that go with each other, and commands that go with the position, in one unit.
    """

    file: str
    source: str
    split: str
    samples: int
    seconds: float
    rate_hz: float
    jitter: float
    gaps: int
    longest_s: float
    ranges: dict[str, tuple[float, float]]
    missing: dict[str, int]
    notes: tuple[str, ...]
    agreeing: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class Import:
    """The result of an import.

    Attributes:
        folder: the log set. trials: in it. skipped: reason → names of files. warnings: on trials that differ from the others.
        log_map: the mapping.
    """

    folder: Path
    trials: tuple[TrialSummary, ...]
    skipped: dict[str, list[str]]
    warnings: tuple[str, ...]
    log_map: LogMap

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Column → smallest and largest value over all trials."""
        found: dict[str, tuple[float, float]] = {}
        for trial in self.trials:
            for name, (low, high) in trial.ranges.items():
                before = found.get(name, (low, high))
                found[name] = min(low, before[0]), max(high, before[1])
        return found

    def unit(self, column: str) -> str:
        """Unit of a column; that of a joint that slides where its mapping has a linear unit, both where it has none."""
        kinds = kinds_of(column)
        parts = column.split("/")
        said = self.log_map.sliding(parts[1]) if parts[0] == "joint" and len(parts) == 3 else None
        fitting = [kind for kind in kinds if len(kinds) == 1 or said is None or slides(kind) is said]
        return " or ".join(KINDS[kind] for kind in fitting)

    def notes(self) -> dict[str, list[str]]:
        """Note → files that it is about."""
        found: dict[str, list[str]] = {}
        for trial in self.trials:
            for note in trial.notes:
                found.setdefault(note, []).append(trial.file)
        return found

    def to_json(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "folder": str(self.folder),
            "map": str(self.log_map.path),
            "trials": [_plain(trial) for trial in self.trials],
            "channels": {n: {"unit": self.unit(n), "min": a, "max": b} for n, (a, b) in self.ranges().items()},
            "skipped": [{"reason": reason, "files": names} for reason, names in self.skipped.items()],
            "warnings": list(self.warnings),
        }


def _plain(trial: TrialSummary) -> dict[str, Any]:
    keys = ("file", "source", "split", "samples", "seconds", "rate_hz", "jitter", "gaps", "longest_s", "missing")
    return {key: getattr(trial, key) for key in keys} | {"notes": list(trial.notes)}


def summarise(file: str, source: str, split: str, columns: dict[str, np.ndarray], notes: Iterable[str]) -> TrialSummary:
    """The summary of a trial that was written."""
    time = columns[TIME]
    runs = regularity(time)
    signals = {name: values for name, values in columns.items() if name != TIME}
    missing = {name: int(np.isnan(values).sum()) for name, values in signals.items()}
    return TrialSummary(
        file=file,
        source=source,
        split=split,
        samples=len(time),
        seconds=float(time[-1]),
        rate_hz=runs.rate_hz,
        jitter=runs.jitter,
        gaps=runs.gaps,
        longest_s=runs.longest_s,
        ranges={
            name: (float(np.nanmin(v)), float(np.nanmax(v))) for name, v in signals.items() if np.isfinite(v).any()
        },
        missing={name: count for name, count in missing.items() if count},
        notes=tuple(notes),
        agreeing=_agreeing(columns),
    )


def _agreeing(columns: dict[str, np.ndarray]) -> frozenset[str]:
    """Columns of joints in which one unit is confirmed by another column."""
    found: set[str] = set()
    time = columns[TIME]
    for joint in joints_of(columns):
        position, velocity, command = (joint_column(joint, c) for c in ("position", "velocity", "position_command"))
        if velocity in columns:
            steps = 0.5 * (columns[velocity][1:] + columns[velocity][:-1]) * np.diff(time)
            travelled = np.concatenate([[0.0], np.nancumsum(steps)])
            if _alike(_strides(travelled), _strides(columns[position])):
                found |= {position, velocity}
        if command in columns and _alike(columns[command], columns[position]):
            found.add(command)
    return frozenset(found)


def _strides(values: np.ndarray) -> np.ndarray:
    """Differences over some samples, so that a coarse encoder does not hide the motion."""
    apart = max(1, len(values) // _STRIDES)
    return values[apart::apart] - values[:-apart:apart]


def _alike(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two signals go together with a slope of about 1."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < _LEAST_POINTS:
        return False
    x, y = second[both] - second[both].mean(), first[both] - first[both].mean()
    scale = np.sqrt((x @ x) * (y @ y))
    return bool(scale > 0 and x @ y > _CORRELATED * scale and _SLOPES[0] < (x @ y) / (x @ x) < _SLOPES[1])


def outliers(trials: Sequence[TrialSummary]) -> list[str]:
    """Trials in which a channel is far larger than in the others, as in another unit.

    A joint alone that moves further, and one whose position and velocity confirm each other, are no sign of that: a recorder
    has one unit for a channel of all joints.
    """
    if len(trials) < _LEAST_TRIALS:
        return []
    names = [name for name in trials[0].ranges if not name.startswith("other/")]  # of no known quantity
    sizes = {n: np.array([max(map(abs, t.ranges.get(n, (np.nan,)))) for t in trials]) for n in names}
    larger = {n: _larger(n, sizes[n], trials) for n in names}
    found = []
    for name in names:
        alike = [n for n in names if _channel(n) == _channel(name)]
        most = 2 * sum(larger[n] for n in alike) > len(alike)
        odd = [
            trial.file
            for trial, each, all_joints in zip(trials, larger[name], most, strict=True)
            if each and all_joints
        ]
        if odd:
            usual = float(np.nanmedian(sizes[name]))
            more = f" and {len(odd) - 3} more" if len(odd) > 3 else ""
            top = float(np.nanmax(sizes[name]))
            what = f"{name} reaches {top:.4g} in {', '.join(odd[:3])}{more}, {usual:.4g} in most trials"
            found.append(f"{what}: another unit or header? split: skip in the mapping leaves them out")
    return found


def _larger(name: str, sizes: np.ndarray, trials: Sequence[TrialSummary]) -> np.ndarray:
    """(N,) bool: in which trials a column is far larger than usual, and nothing confirms its unit."""
    usual = float(np.nanmedian(sizes))
    confirmed = np.array([name in trial.agreeing for trial in trials])
    return (usual > 0) & (sizes > _OUTLIER * usual) & ~confirmed


def _channel(name: str) -> str:
    """The channel of a joint's column, whatever the joint; other columns stand for themselves."""
    parts = name.split("/")
    return parts[2] if parts[0] == "joint" and len(parts) == 3 else name
