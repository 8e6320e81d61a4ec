"""Driving a model with the logged inputs and comparing it with the logged torque."""

from __future__ import annotations

import os
from typing import Protocol

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.loops.actuator_step import HYDRAULIC, PD
from hqpipe.actuators.loops.free_run import free_run as run_kernel
from hqpipe.actuators.loops.free_run import free_run_remembering
from hqpipe.errors import IdentificationError, UsageError
from hqpipe.logs.columns import joint_column
from hqpipe.logs.finer_clock import known_so_far
from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import EFFECTS

WINDOW_S = 0.1  # the default of the gap metric: long beside the actuator's lag, short beside a stride


class TorquePredictor(Protocol):
    """Anything that predicts torque from a log; `ActuatorModel` is handled without it."""

    def predict(self, trajectory: Trajectory, window: int) -> np.ndarray:
        """(T, J) torque, restarted from the log every `window` samples; see `free_run`."""


Model = ActuatorModel | TorquePredictor


def require_channels(trajectory: Trajectory, channels: tuple[str, ...], purpose: str) -> None:
    """Raise unless the trial has the channels.

    Raises:
        IdentificationError: names the missing columns.
    """
    missing = [name for name in channels if getattr(trajectory, name) is None]
    if missing:
        columns = ", ".join(joint_column("<name>", name) for name in missing)
        recorded = ", ".join(trajectory.channels())
        raise IdentificationError(
            f"{purpose} needs {columns}, which the logs lack (they hold {recorded}); record the missing "
            "channel, or use a layer of the diagnosis that does without it"
        )


def window_samples(dt: float, window_s: float, file: str | os.PathLike[str] | None = None) -> int:
    """Samples in a window of `window_s` seconds, at least 2; an error names the log's `file` or folder.

    Raises:
        IdentificationError: the window is shorter than two samples.
    """
    samples = round(window_s / dt)
    if samples < 2:
        of_file = f"{os.fspath(file)}: " if file else ""
        raise IdentificationError(
            f"{of_file}a window of {window_s:g} s holds {samples} samples at {1 / dt:.6g} Hz, expected at least 2",
            file=file,
            field="window_s",
            fix=f"choose a window of {4 * dt:.3g} s or more",
        )
    return samples


def predict(trajectory: Trajectory, model: Model, window: int) -> np.ndarray:
    """Like `free_run`, with the window in samples; 1 is the one-step prediction.

    A model with memory remembers the log up to the start of each window: the log drives a copy of it all along. Between the
    rows of a log that is slower than the model positions go on as they moved, and all else is held.
    """
    if not isinstance(model, ActuatorModel):
        return model.predict(trajectory, window)
    require_channels(trajectory, ("effort", "position_command"), f"replaying the {model.NAME} model")
    per_row = model.steps_per_row(trajectory.dt)
    model = model.for_joints(trajectory.joints)
    if isinstance(model, Augmented):
        _check_effects(model)
    t, window = known_so_far(trajectory, per_row), window * per_row
    signals = (t.effort, t.position_command, t.position, t.velocity)
    if model.KIND in (PD, HYDRAULIC):
        return run_kernel(model.KIND, model.parameters, *signals, window)[::per_row]
    memory = model.memory_columns
    return free_run_remembering(model.KIND, model.parameters, model.weights, memory, *signals, window)[::per_row]


def _check_effects(model: Augmented) -> None:
    # A single sample of torque does not say where in its slack a chain is; what only the log has, the model does not step.
    if bad := sorted(name for name in model.effects if EFFECTS[name].slack or EFFECTS[name].of_the_log):
        raise UsageError(
            f"{model.NAME}: {bad[0]} of {', '.join(model.effects[bad[0]])} cannot be replayed sample by sample from a log; "
            "hqpipe diagnose scores such a model on held-out trials, and the simulator steps it"
        )


def free_run(trajectory: Trajectory, model: Model, window_s: float = WINDOW_S) -> np.ndarray:
    """Predict the torque of a trial from its inputs, restarted from the log every `window_s` seconds.

    Sample k + 1 is computed from the inputs of sample k. Every sample but the first is a prediction; the last
    one of each window is a whole window ahead.

    Args:
        trajectory: one trial.
        model: an actuator model (joints are matched by name) or another predictor.
        window_s: s.

    Returns:
        (T, J) N·m; row 0 is the logged torque.

    Raises:
        IdentificationError: a channel is missing or the window is too short.
        UsageError: the model lacks a joint, belongs to another sample time, or has effects that only windows can replay.
    """
    return predict(trajectory, model, window_samples(trajectory.dt, window_s))
