"""Joints of many robots that have just been reset: which they are, and what they remember at first."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.loops.augmented_columns import PER_OPENING, PER_SPEED
from hqpipe.machine.loops.augmented_step import RING, SAMPLES, SENT, SPOOL, wake


@njit(cache=True, nogil=True, inline="always")
def counts(m: np.ndarray, start: int, size: int) -> tuple[bool, bool]:
    """Whether joints of a block have just been reset, and whether all have seen as many samples."""
    first, asleep, others = m[SAMPLES, start], 0, 0
    for i in range(start, start + size):
        asleep += m[SAMPLES, i] == 0.0
        others += m[SAMPLES, i] != first
    return asleep > 0, others == 0


@njit(cache=True, nogil=True, inline="always")
def wake_block(
    p: np.ndarray,
    m: np.ndarray,
    tau: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    joints: int,
    start: int,
    size: int,
) -> None:
    """Memory of joints that have just been reset, as if each had been held where it is."""
    for first in range(0, size, joints):
        demand = 0.0
        for i in range(first, first + joints):
            k = start + i
            demand += p[PER_SPEED, i] * abs(qd[k]) + p[PER_OPENING, i] * abs(q_des[k] - q[k])
        for i in range(first, first + joints):
            k = start + i
            if m[SAMPLES, k] == 0.0:
                row = m[:, k].copy()
                wake(p[:, i].copy(), row, tau[k], q_des[k], q[k], qd[k], demand)
                row[RING:SENT], row[SENT:] = q_des[k], row[SPOOL]
                m[:, k] = row
