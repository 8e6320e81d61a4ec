"""Defects that make a trial unusable: not finite, clock not increasing, samples missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import TIME, RawTable

MIN_SAMPLES = 10  # assumption: fewer samples cannot be differentiated, let alone fitted
_JITTER_SIGMAS = 8.0  # assumption: a step beyond this many robust sigmas of the clock is a missing sample


def check_values(table: RawTable) -> None:
    """Refuse too short a table, columns of unequal length, and values that are not finite.

    Raises:
        LogError: names file, column and row (counted from 0).
    """
    samples = len(table.columns[TIME])
    check_length(table.path, samples)
    for name, values in table.columns.items():
        if values.shape != (samples,):
            raise LogError(f"{table.path}: column '{name}' has shape {values.shape}, expected ({samples},)")
        if values.dtype.kind not in "fiub":
            raise LogError(f"{table.path}: column '{name}' holds {values.dtype}, expected numbers")
        if values.dtype.kind == "f" and not (finite := np.isfinite(values)).all():
            row = int(np.argmin(finite))
            raise not_finite(table.path, name, row, values[row], int((~finite).sum()))


def check_length(path: Path, samples: int) -> None:
    """Refuse too short a table.

    Raises:
        LogError: names the file.
    """
    if samples < MIN_SAMPLES:
        raise LogError(f"{path}: {samples} rows, expected at least {MIN_SAMPLES}; drop the trial")


def not_finite(path: Path, column: str, row: int, value: float, count: int) -> LogError:
    """What is said of a column with values that are not finite: its first such row (from 0), and how many there are."""
    return LogError(
        f"{path}: column '{column}', row {row}: {value} ({count} such rows); "
        "expected a finite number: repair the rows, cut the trial there, or drop the column"
    )


def check_clock(path: Path, time: np.ndarray) -> None:
    """Refuse a clock that stands still, runs backwards or skips samples.

    Raises:
        LogError: names file and row.
    """
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        what = "repeats" if steps[row - 1] == 0 else "runs backwards"
        raise LogError(
            f"{path}: column 'time', row {row}: {time[row]:.6f} after {time[row - 1]:.6f}, the clock {what}; "
            "expected strictly increasing seconds: sort the rows and drop duplicates"
        )
    median = np.median(steps)
    spread = 1.4826 * np.median(np.abs(steps - median))
    limit = median + max(0.5 * median, _JITTER_SIGMAS * spread)
    if (steps > limit).any():
        row = int(np.argmax(steps > limit)) + 1
        missing = round(steps[row - 1] / median) - 1
        raise LogError(
            f"{path}: column 'time', row {row}: {steps[row - 1]:.6g} s since the row before, expected "
            f"{median:.6g} s (about {missing} samples lost, {(steps > limit).sum()} such gaps); "
            "split the trial into two files at the gap"
        )


def jitter(time: np.ndarray) -> tuple[float, float]:
    """RMS and largest deviation of the sample time from its median, as shares of the median."""
    steps = np.diff(time)
    median = np.median(steps)
    deviation = (steps - median) / median
    return float(np.sqrt(np.mean(deviation**2))), float(np.abs(deviation).max())
