"""Defects that make a trial unusable: too few rows, no numbers, a broken clock, samples missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import TIME, RawTable
from hqpipe.logs.values import find_senseless, senseless_error

MIN_SAMPLES = 10  # assumption: fewer samples cannot be differentiated, let alone fitted
_JITTER_SIGMAS = 8.0  # assumption: a step beyond this many robust sigmas of the clock is a missing sample
_STEPS = (1e-9, 1e11)  # s between samples; 10 kHz counted in days is 1e-9, 100 s counted in ns is 1e11


def check_values(table: RawTable) -> None:
    """Refuse too short a table, columns of unequal length, and samples without physical sense.

    Raises:
        LogError: names file, column and row (counted from 0).
    """
    samples = len(table.columns[TIME])
    check_length(table.path, samples)
    for name, values in table.columns.items():
        if values.shape != (samples,):
            raise LogError(
                f"{table.path}: column '{name}' has shape {values.shape}, expected ({samples},) as 'time' has",
                file=table.path,
                field=name,
                fix="give every column one number per row",
            )
        if values.dtype.kind not in "fiub":
            raise LogError(
                f"{table.path}: column '{name}' holds {values.dtype}, expected numbers",
                file=table.path,
                field=name,
                fix="drop or convert it",
            )
        if found := find_senseless(name, values):
            raise senseless_error(table.path, name, found)


def check_length(path: Path, samples: int) -> None:
    """Refuse too short a table.

    Raises:
        LogError: names the file.
    """
    if samples < MIN_SAMPLES:
        raise LogError(f"{path}: {samples} rows, expected at least {MIN_SAMPLES}", file=path, fix="drop the trial")


def clock(column: np.ndarray) -> np.ndarray:
    """The `time` column (T,) as int64 or float64: integers keep their digits, for nanoseconds have more than a float."""
    return column.astype(np.int64 if column.dtype.kind in "iu" else np.float64, copy=False)


def check_clock(path: Path, time: np.ndarray) -> None:
    """Refuse a clock that stands still, runs backwards, skips samples or has steps that no unit of time explains.

    Args:
        path: for the messages. time: (T,) from `clock`, finite.

    Raises:
        LogError: names file and row.
    """
    steps = np.diff(time).astype(np.float64)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        what = "repeats" if steps[row - 1] == 0 else "runs backwards"
        raise LogError(
            f"{path}: column 'time', row {row}: {time[row]:.6f} after {time[row - 1]:.6f}, the clock {what} "
            f"({int((steps <= 0).sum())} such rows); expected strictly increasing seconds",
            file=path,
            field=TIME,
            fix="sort the rows and drop duplicates",
        )
    median = np.median(steps)
    if not _STEPS[0] <= median <= _STEPS[1]:
        raise LogError(
            f"{path}: column 'time' steps by {median:.6g}, expected seconds between samples, e.g. 0.001",
            file=path,
            field=TIME,
            fix="write the time in seconds",
        )
    spread = 1.4826 * np.median(np.abs(steps - median))
    limit = median + max(0.5 * median, _JITTER_SIGMAS * spread)
    if (steps > limit).any():
        row = int(np.argmax(steps > limit)) + 1
        missing = round(steps[row - 1] / median) - 1
        raise LogError(
            f"{path}: column 'time', row {row}: {steps[row - 1]:.6g} s since the row before, expected "
            f"{median:.6g} s (about {missing} samples lost, {(steps > limit).sum()} such gaps)",
            file=path,
            field=TIME,
            fix="split the trial into two files at the gap",
        )


def jitter(time: np.ndarray) -> tuple[float, float]:
    """RMS and largest deviation of the sample time from its median, as shares of the median."""
    steps = np.diff(time)
    median = np.median(steps)
    deviation = (steps - median) / median
    return float(np.sqrt(np.mean(deviation**2))), float(np.abs(deviation).max())
