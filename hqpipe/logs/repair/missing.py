"""Samples that are missing or without physical sense: set to NaN and counted, to be bridged or left out later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import TIME, RawTable
from hqpipe.logs.values import sound_samples

MOST_MISSING = 0.5  # of the samples of a column; assumption: of a channel that is mostly missing nothing can be trusted


@dataclass(frozen=True, eq=False)
class Masked:
    """A table whose samples are finite or NaN.

    Attributes:
        table: as read. missing: column → how many of its samples are NaN, for those that have any.
    """

    table: RawTable
    missing: dict[str, int]


def mask(table: RawTable) -> Masked:
    """Set samples that no sensor reads to NaN.

    Args:
        table: numeric columns of equal length; NaN where a value is missing.

    Raises:
        LogError: the clock itself has no value somewhere.
    """
    columns, missing = {}, {}
    for name, values in table.columns.items():
        if values.dtype.kind not in "fiu" or (sound := sound_samples(name, values)).all():
            columns[name] = values
            continue
        if name == TIME:
            row = int(np.argmin(sound))
            raise LogError(
                f"{table.path}: column 'time', row {row}: {values[row]:.6g} ({int((~sound).sum())} such rows), "
                "expected a finite number",
                file=table.path,
                field=TIME,
                fix="drop the rows, or cut the trial there",
            )
        columns[name] = np.where(sound, values.astype(np.float64, copy=False), np.nan)
        missing[name] = int((~sound).sum())
    return Masked(RawTable(table.path, columns, table.metadata), missing)
