"""What a model costs: wall time of its fit, and of one step. For information; no result depends on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from hqpipe.logs.trajectory import Trajectory
from hqpipe.sysid.free_run import WINDOW_S, Model, predict, window_samples

T = TypeVar("T")

_SECONDS = 2.0  # s of a trial that are replayed
_REPEATS = 3  # the fastest counts: whatever else the computer does only slows it down


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What `call` returns, and the wall time that it took, s."""
    started = time.perf_counter()
    result = call()
    return result, time.perf_counter() - started


def step_time(trajectory: Trajectory, model: Model, window_s: float = WINDOW_S) -> float:
    """Wall time of one free-running step of all joints, s.

    Args:
        trajectory: a trial that the model can be replayed on; its first two seconds are.
        model: see `hqpipe.sysid.free_run.Model`. window_s: s.
    """
    window = window_samples(trajectory.dt, window_s)
    part = trajectory.section(0, min(trajectory.samples, round(_SECONDS / trajectory.dt) + 1))
    predict(part, model, window)  # compiles, and fills caches
    return min(timed(lambda: predict(part, model, window))[1] for _ in range(_REPEATS)) / (part.samples - 1)
