"""What a logged supply pressure says of a supply that may sag."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.trajectory import LogSet

PRESSURE = "supply/pressure"  # Pa, column of the log format
DROOP = "supply_droop"
STEADY = 0.02
"""Swing of the pressure over its median, from the 0.5th to the 99.5th percentile: the flow goes with the root, so that less
moves it by less than 1 %. Assumption."""
SWING = (0.5, 99.5)  # percentiles: single readings of a noisy sensor are no swing


def is_steady(log_set: LogSet) -> bool:
    """Whether the supply pressure was logged in every trial and hardly moved in any."""
    pressures = [trial.trajectory.extra.get(PRESSURE) for trial in log_set.trials]
    if any(p is None or not np.isfinite(p).all() or np.median(p) <= 0.0 for p in pressures):
        return False
    return all(np.ptp(np.percentile(p, SWING)) < STEADY * np.median(p) for p in pressures)


def without_steady(names: tuple[str, ...], log_set: LogSet) -> tuple[str, ...]:
    """The candidates without a sagging supply where the logged pressure shows that it does not sag."""
    return tuple(name for name in names if name != DROOP) if is_steady(log_set) else names
