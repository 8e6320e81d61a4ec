"""What a model costs: wall time of its fit, and of one step. For information; no result depends on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.loops.free_run import step_along
from hqpipe.identify.free_run import WINDOW_S, window_samples
from hqpipe.logs.trajectory import Trajectory

T = TypeVar("T")

_SECONDS = 2.0  # s of a trial that are replayed
_REPEATS = 3  # the fastest counts: whatever else the computer does only slows it down


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What `call` returns, and the wall time that it took, s."""
    started = time.perf_counter()
    result = call()
    return result, time.perf_counter() - started


def step_time(trajectory: Trajectory, model: ActuatorModel, window_s: float = WINDOW_S) -> float:
    """Wall time of one step of all joints, as the simulator steps them, s.

    Args:
        trajectory: a trial with torque and position command; the model is stepped along its first two seconds.
        window_s: s after which the torque is set to the logged one again, so that no model runs away.
    """
    window = window_samples(trajectory.dt, window_s)
    part = trajectory.section(0, min(trajectory.samples, round(_SECONDS / trajectory.dt) + 1))
    model = model.for_joints(part.joints)
    signals = (part.effort, part.position_command, part.position, part.velocity)

    def along() -> np.ndarray:
        return step_along(model.KIND, model.parameters, model.weights, model.memory_columns, *signals, window)

    along()  # compiles, and fills caches
    return min(timed(along)[1] for _ in range(_REPEATS)) / (part.samples - 1)
