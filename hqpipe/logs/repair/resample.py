"""A stretch of a trial on a uniform clock: measured signals interpolated, commands held, what was not recorded marked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.logs.clocks import clock, gap_limit
from hqpipe.logs.columns import TIME, RawTable

_HELD = ("position_command", "effort_command", "valve_command", "contact")
_COARSER = 1.25  # ratio of sample times beyond which a measured signal is averaged before it is thinned out; assumption


@dataclass(frozen=True, eq=False)
class Uniform:
    """A table on a uniform clock without missing values.

    Attributes:
        observed: column → (T,) False where a measured value stands between samples that were not recorded; only columns
            that have such values.
    """

    table: RawTable
    observed: dict[str, np.ndarray]


def is_held(column: str) -> bool:
    """Whether the column keeps the value that was last sent, as commands and contacts do."""
    return column.rsplit("/", 1)[-1] in _HELD or column.startswith("command/")


def fill(table: RawTable) -> Uniform:
    """Bridge missing values on the clock as it is.

    Args:
        table: with a strictly increasing `time`; NaN where a value is missing.
    """
    columns, observed = {}, {}
    rows = np.arange(len(table.columns[TIME]), dtype=np.float64)
    for name, values in table.columns.items():
        present = np.isfinite(values) if values.dtype.kind == "f" else None
        if present is None or present.all():
            columns[name] = values
            continue
        if is_held(name):
            columns[name] = values[_last(rows, rows[present], np.flatnonzero(present))]
        else:
            columns[name] = np.interp(rows, rows[present], values[present])
            observed[name] = present
    return Uniform(RawTable(table.path, columns, table.metadata), observed)


def resample(table: RawTable, dt: float) -> Uniform:
    """Bring every column to a uniform clock.

    Measured signals are interpolated linearly, after a centred mean over `dt` where they were sampled faster; commands and
    contacts keep the value that was last sent.

    Args:
        table: columns with a strictly increasing `time`; NaN where a value is missing. dt: the new sample time, s.
    """
    time = clock(table.columns[TIME])
    time = (time - time[0]).astype(np.float64)
    own = float(np.median(np.diff(time)))
    uniform = dt * np.arange(int(np.floor(time[-1] / dt + 1e-9)) + 1)
    columns, observed = {TIME: uniform}, {}
    every = np.arange(len(time))
    seen_by_all = _seen(uniform, time, dt)
    for name, values in table.columns.items():
        if name == TIME:
            continue
        present = np.isfinite(values) if values.dtype.kind == "f" else np.ones(len(values), dtype=bool)
        if is_held(name):
            columns[name] = values[_last(uniform + 1e-9 * dt, time[present], every[present])]
            continue
        whole = bool(present.all())
        known = values[present].astype(np.float64)
        if dt > _COARSER * own:
            known = _averaged(known, max(1, round(dt / own)))
        columns[name] = np.interp(uniform, time[present], known)
        seen = seen_by_all if whole else _seen(uniform, time[present], dt, gap_limit(np.diff(time)))
        if not seen.all():
            observed[name] = seen
    ordered = {name: columns[name] for name in table.columns}
    return Uniform(RawTable(table.path, ordered, table.metadata), observed)


def _last(at: np.ndarray, time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(N,) of `rows`, at each instant of `at` the last one whose `time` has come."""
    return rows[np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)]


def _averaged(values: np.ndarray, span: int) -> np.ndarray:
    """Centred mean over `span` samples, fewer at the ends."""
    from scipy.ndimage import uniform_filter1d

    return uniform_filter1d(values, span, mode="nearest")


def _seen(uniform: np.ndarray, time: np.ndarray, dt: float, longest: float | None = None) -> np.ndarray:
    """(N,) whether an instant lies at a sample or between two that follow each other.

    Args:
        uniform: (N,) s. time: (T,) of the samples that have a value. dt: of `uniform`.
        longest: step between samples that follow each other; by default as the clock itself says.
    """
    steps = np.diff(time)
    longest = max(gap_limit(steps) if longest is None else longest, 0.0) * (1.0 + 1e-9)
    after = np.clip(np.searchsorted(time, uniform, side="left"), 1, len(time) - 1)
    nearest = np.minimum(np.abs(uniform - time[after - 1]), np.abs(uniform - time[after]))
    between = (steps[after - 1] <= longest) & (steps[after - 1] <= _COARSER * 1.5 * dt)
    return between | (nearest <= 0.5 * dt * (1.0 + 1e-9))
