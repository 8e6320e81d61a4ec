"""What a trial must be: long enough, of numbers; and, where nothing is to be repaired, without a gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.clocks import STEADY, read_clock, repeated_rows
from hqpipe.logs.columns import TIME, RawTable
from hqpipe.logs.values import find_senseless, senseless_error

MIN_SAMPLES = 10  # assumption: fewer samples cannot be differentiated, let alone fitted


def check_values(table: RawTable) -> None:
    """Refuse what `check_shapes` refuses, and samples that are missing or without physical sense.

    Raises:
        LogError: names file, column and row (counted from 0).
    """
    check_shapes(table)
    for name, values in table.columns.items():
        if found := find_senseless(name, values):
            raise senseless_error(table.path, name, found)


def check_shapes(table: RawTable) -> None:
    """Refuse too short a table, columns of unequal length and what is no number.

    Raises:
        LogError: names file and column.
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


def check_length(path: Path, samples: int) -> None:
    """Refuse too short a table.

    Raises:
        LogError: names the file.
    """
    if samples < MIN_SAMPLES:
        raise LogError(f"{path}: {samples} rows, expected at least {MIN_SAMPLES}", file=path, fix="drop the trial")


def check_clock(path: Path, time: np.ndarray) -> None:
    """Refuse a clock that stands still, runs backwards, skips rows, jitters or has steps that no unit of time explains.

    Args:
        path: for the messages. time: (T,) from `clock`, finite.

    Raises:
        LogError: names file and row.
    """
    if (repeated := repeated_rows(path, time)).any():
        row = int(np.argmax(repeated))
        raise LogError(
            f"{path}: column 'time', row {row}: {time[row]:.6f} again, the clock repeats ({int(repeated.sum())} such rows); "
            "expected strictly increasing seconds",
            file=path,
            field=TIME,
            fix="drop the repeated rows",
        )
    found = read_clock(time)
    if found.lost.any():
        row = int(np.argmax(found.lost > 0)) + 1
        raise LogError(
            f"{path}: column 'time', row {row}: {float(time[row] - time[row - 1]):.6g} s since the row before, expected "
            f"{found.dt:.6g} s (about {found.lost[row - 1]} samples lost, {int((found.lost > 0).sum())} such gaps)",
            file=path,
            field=TIME,
            fix="split the trial into two files at the gap",
        )
    if found.jitter_rms > STEADY:
        raise LogError(
            f"{path}: column 'time' jitters by {found.jitter_rms:.1%} of a sample (largest {found.jitter_max:.0%}), "
            f"expected at most {STEADY:.0%}",
            file=path,
            field=TIME,
            fix="record on a steady clock, or bring the trial to one",
        )
