"""Free-running replay of a log: the model carries its own torque, restarted from the log at every window."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.kernels.actuator_step import step_joint


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
    """Predict the torque of one trial from its logged inputs.

    The state is set to the logged torque at samples 0, W, 2W, …; sample k + 1 is always computed from the
    inputs of sample k, so that every sample but the first is a prediction and the last sample of a window is
    W steps ahead. ``window=1`` is the one-step prediction.

    Args:
        kind: model, see `hqpipe.kernels.actuator_step`.
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
