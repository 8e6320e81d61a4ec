"""Logs on the clock of the machine's controller, which may be faster than that of the log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from hqpipe.logs.trajectory import Trajectory

STEP = 1e-3  # s, of the paper's controller; that of another machine is near enough for what a joint follows
MOST = 20  # steps from one row to the next; assumption: what a row does not say is then cut finely enough


def steps_per_row(dt: float) -> int:
    """How many steps of the controller lie between two rows of a log; dt: s."""
    return min(max(1, round(dt / STEP)), MOST)


def between(values: np.ndarray, steps: int) -> np.ndarray:
    """((T − 1) steps + 1, …) values (T, …) on a cubic spline through the rows."""
    if steps == 1:
        return values
    rows = np.arange(len(values))
    return CubicSpline(rows, values)(np.arange((len(values) - 1) * steps + 1) / steps)


def held(values: np.ndarray, steps: int) -> np.ndarray:
    """((T − 1) steps + 1, …) values (T, …), each kept until the next row."""
    return values if steps == 1 else np.concatenate([np.repeat(values[:-1], steps, axis=0), values[-1:]])


def continued(values: np.ndarray, steps: int) -> np.ndarray:
    """((T − 1) steps + 1, …) values (T, …), from each row on as they changed before it: what is known without the next one."""
    if steps == 1:
        return values
    before = np.diff(values, axis=0, prepend=values[:1])
    change = before + np.diff(before, axis=0, prepend=before[:1])
    share = np.arange((len(values) - 1) * steps + 1) % steps / steps
    return held(values, steps) + share.reshape(-1, *[1] * (values.ndim - 1)) * held(change, steps)


def known_so_far(trajectory: Trajectory, steps: int) -> Trajectory:
    """A trial with so many samples from one row to the next, by what each row and those before it tell: positions go on as they
    moved, all else is held."""
    if steps == 1:
        return trajectory
    channels = {name: held(values, steps) for name, values in trajectory.channels().items()}
    channels["position"] = continued(trajectory.position, steps)
    observed = None if trajectory.observed is None else held(trajectory.observed, steps)
    extra = {name: held(values, steps) for name, values in trajectory.extra.items()}
    return replace(trajectory, time=between(trajectory.time, steps), observed=observed, extra=extra, **channels)
