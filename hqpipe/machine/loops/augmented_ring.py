"""Rings of past values in the memory of the simulator's joints, for delays; one joint, or a block of joints at once."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

RING_LENGTH: Final = 96  # samples: the longest delay of the library at 1 kHz, and some


@njit(cache=True, nogil=True, inline="always")
def past(memory: np.ndarray, ring: int, now: int, lag: float) -> float:
    """What was put into a ring `lag` samples ago by linear interpolation; no older than the first."""
    lag = min(max(lag, 0.0), min(float(now), RING_LENGTH - 2.0))
    whole = int(lag)
    part = lag - whole
    newer = memory[ring + (now - whole) % RING_LENGTH]
    older = memory[ring + (now - min(whole + 1, now)) % RING_LENGTH]
    return newer + part * (older - newer)


@njit(cache=True, nogil=True, inline="always")
def delayed_block(
    d: np.ndarray,
    m: np.ndarray,
    samples: int,
    ring: int,
    whole: int,
    part: int,
    alike: bool,
    u: np.ndarray,
    start: int,
    size: int,
) -> None:
    """Put `u` (B,) into a ring and take what was put there before.

    Args:
        d, m: of `hqpipe.machine.loops.augmented_batch`. samples, ring: rows of m with the samples seen, and where the ring
            starts.
        whole, part: rows of d with the delay in whole samples and what is beyond.
        alike: whether all joints have the same whole samples of delay, and have seen as many.
    """
    if alike:
        slot = int(m[samples, start]) % RING_LENGTH
        newer = (slot - int(d[whole, 0])) % RING_LENGTH
        older = (newer - 1) % RING_LENGTH
        for i in range(size):
            m[ring + slot, start + i] = u[i]
        for i in range(size):
            k = start + i
            u[i] = m[ring + newer, k] + d[part, i] * (m[ring + older, k] - m[ring + newer, k])
    else:
        for i in range(size):
            k = start + i
            slot = int(m[samples, k]) % RING_LENGTH
            m[ring + slot, k] = u[i]
            newer = slot - int(d[whole, i])
            newer = newer + RING_LENGTH if newer < 0 else newer
            older = newer - 1 if newer > 0 else RING_LENGTH - 1
            u[i] = m[ring + newer, k] + d[part, i] * (m[ring + older, k] - m[ring + newer, k])
