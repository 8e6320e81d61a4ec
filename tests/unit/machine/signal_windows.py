"""Trajectories as the compiled loops read them: one joint, cut into complete windows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.logs.differentiate import step_speed
from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine.chain import Signals


def windows_of(trials: Sequence[Trajectory], j: int, steps: int, logged_speed: bool = False) -> Signals:
    """Joint `j` of trials, end to end; its speed is the logged one, or that from each position to the next."""

    def joined(pick) -> np.ndarray:
        return np.ascontiguousarray(np.concatenate([pick(t) for t in trials]), dtype=np.float64)

    bounds = np.cumsum([0, *(t.samples for t in trials)])
    first = np.concatenate([np.arange(a, b - steps, steps) for a, b in zip(bounds[:-1], bounds[1:], strict=True)])
    effort = joined(lambda t: t.effort[:, j])
    return Signals(
        command=joined(lambda t: t.position_command[:, j]),
        position=joined(lambda t: t.position[:, j]),
        velocity=joined(lambda t: t.velocity[:, j] if logged_speed else step_speed(t.position[:, j], t.dt)),
        effort=effort,
        time=joined(lambda t: t.time - t.time[0]),
        demand=joined(lambda t: np.abs(t.velocity).sum(axis=1)),
        bounds=bounds.astype(np.int64),
        first=first.astype(np.int64),
        steps=steps,
        target=np.ascontiguousarray(effort[first[None, :] + np.arange(steps + 1)[:, None]]),
    )
