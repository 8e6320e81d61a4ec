"""Free-running replay of a log: the model carries its own torque, restarted from the log at every window."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.actuators.loops.actuator_step import step_joint, step_row, take_back


@njit(cache=True, nogil=True)
def free_run(
    kind: int,
    parameters: np.ndarray,
    effort: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    window: int,
) -> np.ndarray:
    """Predict the torque of one trial from its logged inputs with a model that remembers nothing but its torque.

    The state is set to the logged torque at samples 0, W, 2W, …; sample k + 1 is always computed from the
    inputs of sample k, so that every sample but the first is a prediction and the last sample of a window is
    W steps ahead. ``window=1`` is the one-step prediction.

    Args:
        kind: PD or HYDRAULIC, see `hqpipe.actuators.loops.actuator_step`.
        parameters: (J, P) float64.
        effort, q_des, q, qd: (T, J) N·m, rad, rad, rad/s.
        window: W, samples.

    Returns:
        (T, J) N·m; row 0 is the logged torque.
    """
    samples, joints = effort.shape
    predicted = np.empty((samples, joints))
    for j in range(joints):
        p = parameters[j]
        torque = effort[0, j]
        predicted[0, j] = torque
        for k in range(samples - 1):
            if k % window == 0:
                torque = effort[k, j]
            torque = step_joint(kind, p, torque, q_des[k, j], q[k, j], qd[k, j])
            predicted[k + 1, j] = torque
    return predicted


@njit(cache=True, nogil=True)
def free_run_remembering(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    columns: int,
    effort: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    window: int,
) -> np.ndarray:
    """`free_run` for a model with memory, or one whose joints hang together.

    A second copy of the model is driven along: the log sets its torque at every sample. Where a window starts, the
    free-running copy takes over the memory of the driven one along with the logged torque.

    Args:
        kind, weights: see `hqpipe.actuators.loops.actuator_step.step_row`. columns: M of the memory.
        parameters, effort, q_des, q, qd, window: as in `free_run`.

    Returns:
        (T, J) N·m; row 0 is the logged torque.
    """
    samples, joints = effort.shape
    predicted = np.empty((samples, joints))
    predicted[0] = effort[0]
    driven, free = np.zeros((joints, columns)), np.zeros((joints, columns))
    logged, torque = np.empty(joints), np.empty(joints)
    for k in range(samples - 1):
        if k % window == 0:
            torque[:] = effort[k]
            free[:] = driven
        step_row(kind, parameters, weights, torque, free, q_des[k], q[k], qd[k])
        predicted[k + 1] = torque
        logged[:] = effort[k]
        step_row(kind, parameters, weights, logged, driven, q_des[k], q[k], qd[k])
        for j in range(joints):
            take_back(kind, driven[j], logged[j] - effort[k + 1, j])
    return predicted


@njit(cache=True, nogil=True)
def step_along(
    kind: int,
    parameters: np.ndarray,
    weights: np.ndarray,
    columns: int,
    effort: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    window: int,
) -> np.ndarray:
    """Step one copy of a model through a trial, as a simulator does; its torque is set to the log's every `window` samples.

    Args:
        all of them: as in `free_run_remembering`, with J = the joints of the model.

    Returns:
        (J,) N·m after the last sample.
    """
    memory, torque = np.zeros((effort.shape[1], columns)), np.empty(effort.shape[1])
    for k in range(effort.shape[0] - 1):
        if k % window == 0:
            torque[:] = effort[k]
        step_row(kind, parameters, weights, torque, memory, q_des[k], q[k], qd[k])
    return torque
