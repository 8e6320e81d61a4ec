"""Rows of a log as far apart as the simulation of a joint needs them.

A servo that takes 0.3 s to follow its command shows nothing from one row of 1 kHz to the next. Simulated row by row, a window
costs so much that only a few of a log can be looked at.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hqpipe.layers.servo.scale import VOLTAGE
from hqpipe.logs.columns import joint_column
from hqpipe.logs.trajectory import Trajectory, Trial

FINE = 25.0  # steps of a response time; Verlet is then exact to about 1e-3
LEAST_WINDOW = 10  # rows; with fewer the initial state, fitted to 7, decides


def rows_of_step(row_s: float, response_s: float, window_s: float | None) -> int:
    """How many rows make one step: as many as a response time has to spare, and a window that was asked for.

    Args:
        row_s: s from row to row. response_s: of the joint. window_s: s, length of a free run that was asked for, or None.
    """
    longest = response_s / FINE
    if window_s is not None:
        longest = min(longest, window_s / LEAST_WINDOW)
    return max(int(longest / row_s * (1.0 + 1e-9)), 1)


def thinned(trial: Trial, joint: str, every: int) -> Trial:
    """A trial with one row of `every`, whose inputs are means, so that what they did between two rows counts.

    A command is held from its row on, so it is the mean of that row and of those that are left out behind it. Duty and voltage
    are measured, and their means are about the row.
    """
    t = trial.trajectory
    kept = every * np.arange(t.samples // every)
    behind, about = np.arange(every), np.arange(-(every // 2), every // 2 + 1)

    def mean(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return values[np.clip(kept[:, None] + rows, 0, t.samples - 1)].mean(axis=1)

    measured = (VOLTAGE, joint_column(joint, "duty"))
    extra = {name: mean(x, about) if name in measured else x[kept] for name, x in t.extra.items()}
    rows: dict[str, np.ndarray] = {name: x[kept] for name, x in t.channels().items()}
    if t.position_command is not None:
        rows["position_command"] = mean(t.position_command, behind)
    if t.duty is not None:
        rows["duty"] = mean(t.duty, about)
    observed = None if t.observed is None else t.observed[kept]
    thin: Trajectory = replace(t, time=t.time[kept], extra=extra, observed=observed, **rows)
    return replace(trial, trajectory=thin)
