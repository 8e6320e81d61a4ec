"""What an import made: trials, ranges, what was left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.logs.columns import TIME
from hqpipe.logs.imports.clock import regularity
from hqpipe.logs.imports.mapping import LogMap
from hqpipe.logs.imports.units import KINDS, kinds_of, slides

_OUTLIER = 5.0  # times the usual size; assumption: motions differ by less, units (cm, mm, deg) by more
_LEAST_TRIALS = 4  # that tell what is usual


@dataclass(frozen=True, eq=False)
class TrialSummary:
    """One trial.

    Attributes:
        file: in the log set. source: file that it comes from. split: "fit" or "heldout".
        gaps: steps of more than four median ones, longest_s the longest step.
        ranges: column → smallest and largest value. missing: column → samples without a value.
        notes: on reading and converting it.
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
    )


def outliers(trials: Sequence[TrialSummary]) -> list[str]:
    """Trials in which a channel is far larger than in the others, as in another unit."""
    found = []
    for name in trials[0].ranges if len(trials) >= _LEAST_TRIALS else ():
        sizes = np.array([max(map(abs, trial.ranges.get(name, (np.nan,)))) for trial in trials])
        usual = float(np.nanmedian(sizes))
        odd = [t.file for t, size in zip(trials, sizes, strict=True) if usual > 0 and size > _OUTLIER * usual]
        if odd:
            more = f" and {len(odd) - 3} more" if len(odd) > 3 else ""
            top = float(np.nanmax(sizes))
            what = f"{name} reaches {top:.4g} in {', '.join(odd[:3])}{more}, {usual:.4g} in most trials"
            found.append(f"{what}: another unit or header? split: skip in the mapping leaves them out")
    return found
