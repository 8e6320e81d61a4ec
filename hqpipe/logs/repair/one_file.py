"""From a file as recorded to stretches on a sound clock: missing samples bridged or cut out, jitter taken away."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.logs.checks import MIN_SAMPLES, check_shapes
from hqpipe.logs.clocks import Clock, clock, is_regular, read_clock, repeated_rows
from hqpipe.logs.columns import TIME, RawTable, joint_column, joints_of
from hqpipe.logs.repair.missing import mask
from hqpipe.logs.repair.resample import Uniform, fill, resample
from hqpipe.logs.repair.segments import bridgeable, stretches

NEEDED = ("position", "velocity", "effort", "position_command", "effort_command", "valve_command")
"""Channels of a joint without which a sample says nothing; a missing value of any other column cuts no trial."""


@dataclass(frozen=True, eq=False)
class Source:
    """A file as recorded, looked through.

    Attributes:
        table: NaN where a sample is missing; no two rows bear the same time. missing: column → number of NaN.
        clock: of the file.
    """

    table: RawTable
    missing: dict[str, int]
    clock: Clock

    @property
    def rows(self) -> int:
        return len(self.table.columns[TIME])

    def without(self, columns: Iterable[str]) -> Source:
        """The same file less some columns."""
        dropped = set(columns)
        kept = {name: values for name, values in self.table.columns.items() if name not in dropped}
        missing = {name: count for name, count in self.missing.items() if name not in dropped}
        return replace(self, table=RawTable(self.table.path, kept, self.table.metadata), missing=missing)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Rows of a file on a sound clock.

    Attributes:
        start: s from the first row of the file. data: its values.
    """

    start: float
    data: Uniform


@dataclass(frozen=True, eq=False)
class Repaired:
    """A file after its repair.

    Attributes:
        stretches: in order of time. bridged: most samples in a row that are bridged.
        absent: share of the samples that no stretch holds, or that are bridged in one.
        resampled: whether its clock was changed.
    """

    stretches: tuple[Stretch, ...]
    bridged: int
    absent: float
    resampled: bool


def look_through(table: RawTable) -> Source:
    """Mark what is missing in a file, and read its clock.

    Raises:
        LogError: columns of unequal length, too few rows, or a clock that cannot be used.
    """
    check_shapes(table)
    masked = mask(table)
    table = masked.table
    time = clock(table.columns[TIME])
    repeated = repeated_rows(table.path, time)
    if repeated.any():
        kept = {name: values[~repeated] for name, values in table.columns.items()}
        table, time = RawTable(table.path, kept, table.metadata), time[~repeated]
    missing = {name: int(np.isnan(table.columns[name]).sum()) for name in masked.missing}
    return Source(table, {n: c for n, c in missing.items() if c}, read_clock(time, int(repeated.sum())))


def repair(source: Source, dt: float) -> Repaired:
    """Cut a file at its long gaps and bridge the short ones.

    Args:
        source: from `look_through`. dt: sample time of its log set, s; rows on a steady clock of that rate stay as they are.
    """
    table, own = source.table, source.clock
    regular = is_regular(own, dt)
    if regular and not source.missing and not own.lost.any():
        return Repaired((Stretch(0.0, Uniform(table, {})),), 0, 0.0, False)
    needed = [c for joint in joints_of(table.columns) for c in (joint_column(joint, ch) for ch in NEEDED)]
    missing = np.zeros(source.rows, dtype=bool)
    for name in source.missing:
        if name in needed:
            missing |= np.isnan(table.columns[name])
    reach = 0
    if missing.any() or own.lost.any():
        positions = (table.columns[joint_column(joint, "position")] for joint in joints_of(table.columns))
        reach = bridgeable(q.astype(np.float64) for q in positions)
    time = clock(table.columns[TIME])
    found, samples = [], 0
    for start, stop in stretches(own.lost, missing, reach, MIN_SAMPLES):
        part = RawTable(table.path, {n: v[start:stop] for n, v in table.columns.items()}, table.metadata)
        whole = regular and not own.lost[start : stop - 1].any()
        data = fill(part) if whole else resample(part, dt)
        if len(data.table.columns[TIME]) < MIN_SAMPLES:
            continue
        found.append(Stretch(float(time[start] - time[0]), data))
        samples += int(np.sum(~missing[start:stop]))
    recorded = source.rows + int(own.lost.sum())
    return Repaired(tuple(found), reach, 1.0 - samples / recorded, not regular)
