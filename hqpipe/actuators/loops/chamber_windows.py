"""Free-running replay of the two-chamber model over the windows of a joint, for its fit."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.actuators.loops.chamber_step import MEMORY, chamber_joint


@njit(cache=True, nogil=True)
def replay(
    p: np.ndarray,
    effort: np.ndarray,
    command: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    bounds: np.ndarray,
    starts: np.ndarray,
    simulated: np.ndarray,
) -> None:
    """Simulate every window with the memory that the log before it leaves behind.

    A copy of the memory is driven along with the logged torque through a whole trial. At the first sample of a window
    the free-running copy takes over its memory, and the logged torque.

    Args:
        p: (P,) parameters of the joint, see `hqpipe.actuators.loops.chamber_step`.
        effort, command, q, qd: (T,) N·m, rad, rad, rad/s, the trials end to end.
        bounds: (W, 2) first and last sample of each window.
        starts: (W,) bool: the window is the first of its trial, memory wakes anew.
        simulated: (T,) N·m, overwritten where a window predicts.
    """
    led, free = np.zeros(MEMORY), np.zeros(MEMORY)
    for w in range(bounds.shape[0]):
        first, last = bounds[w]
        if starts[w]:
            led[:] = 0.0
        free[:] = led
        torque = effort[first]
        for k in range(first, last):
            torque = chamber_joint(p, free, torque, command[k], q[k], qd[k])
            simulated[k + 1] = torque
            chamber_joint(p, led, effort[k], command[k], q[k], qd[k])
