"""Many robots at once, for the models whose laws fit into vector instructions.

The laws are those of `hqpipe.actuators.loops.actuator_step`. Here the joints of all robots lie end to end and every link of the
chain is one plain loop over a block of them, so that the compiler works on several joints per instruction.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.actuators.loops.laws import clip, impact

BLOCK: Final = 96  # elements: with some twenty columns a block stays in the first-level cache


def hydraulic_columns(parameters: np.ndarray) -> np.ndarray:
    """(5, B) joint-space gains and limit, repeated for as many robots as a block holds; parameters: (J, 6)."""
    k1, k2, k3, k4, radius, limit = parameters.T
    gains = np.stack([k1 * radius**2, 1.0 - k2, k3 * radius**2, k4 * radius, limit])
    return np.tile(gains, max(1, BLOCK // len(parameters)))


@njit(cache=True, nogil=True)
def hydraulic_batch(table: np.ndarray, tau: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
    """Eq. (7) for joints that lie end to end, in place.

    Args:
        table: (5, B) k1 R², 1 − k2, k3 R², k4 R and the limit, see `hydraulic_columns`.
        tau: (n,) torque, overwritten, N·m; q_des, q, qd: (n,) rad, rad, rad/s.
    """
    block = table.shape[1]
    push, keep, drag, corrected, limit = table[0], table[1], table[2], table[3], table[4]
    for start in range(0, tau.shape[0], block):
        for i in range(min(block, tau.shape[0] - start)):
            k = start + i
            torque, error = tau[k], q_des[k] - q[k]
            following = push[i] * error + keep[i] * torque - drag[i] * qd[k] + corrected[i] * impact(torque, error)
            tau[k] = clip(following, limit[i])
