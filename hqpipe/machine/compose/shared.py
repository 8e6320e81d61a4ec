"""What the loops of every chain call: the past of a signal, in a log and in the memory of a simulator."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

FORGOTTEN: Final = 8.0
"""Range that the sum of a signal goes through, after which a state that it moves between −1 and 1 has been at an end: 2 if
nothing else moves it, and as much again three times for what does; assumption."""
RING: Final = 96  # samples: the longest delay of the library at 1 kHz, and some


@njit(cache=True, nogil=True, inline="always")
def delayed(signal: np.ndarray, first: int, last: int, at: float) -> float:
    """`signal` at a sample `at` by linear interpolation, held beyond `first` and `last`."""
    at = min(max(at, float(first)), float(last))
    whole = min(int(at), last - 1)
    part = at - whole
    return signal[whole] + part * (signal[whole + 1] - signal[whole])


@njit(cache=True, nogil=True)
def remembered(moves: np.ndarray, earliest: int, last: int) -> int:
    """The sample from which a state has to be followed to be known at `last`; not before `earliest`.

    Args:
        moves: (T,) by how much it moves between −1 and 1 in a sample.
    """
    total = low = high = 0.0
    while last > earliest and high - low < FORGOTTEN:
        last -= 1
        total += moves[last]
        low, high = min(low, total), max(high, total)
    return last


@njit(cache=True, nogil=True)
def lay_out(sequence: np.ndarray, first: np.ndarray, out: np.ndarray) -> None:
    """Windows side by side: out[k, w] = sequence[first[w] + k]."""
    for k in range(out.shape[0]):
        for w in range(first.shape[0]):
            out[k, w] = sequence[first[w] + k]


@njit(cache=True, nogil=True, inline="always")
def past(memory: np.ndarray, ring: int, now: int, lag: float) -> float:
    """What was put into a ring `lag` samples ago by linear interpolation; no older than it reaches."""
    lag = min(max(lag, 0.0), RING - 2.0)
    whole = int(lag)
    part = lag - whole
    newer = memory[ring + (now - whole) % RING]
    older = memory[ring + (now - whole - 1) % RING]
    return newer + part * (older - newer)


@njit(cache=True, nogil=True, inline="always")
def counts(m: np.ndarray, start: int, size: int) -> tuple[bool, bool]:
    """Whether joints of a block have just been reset, and whether all have seen as many samples.

    Args:
        m: (MEMORY, n); the first row holds the samples.
    """
    first, asleep, others = m[0, start], 0, 0
    for i in range(start, start + size):
        asleep += m[0, i] == 0.0
        others += m[0, i] != first
    return asleep > 0, others == 0


@njit(cache=True, nogil=True, inline="always")
def delayed_block(
    d: np.ndarray, m: np.ndarray, ring: int, whole: int, alike: bool, u: np.ndarray, start: int, size: int
) -> None:
    """Put `u` (B,) into a ring and take what was put there before.

    Args:
        d: (C, B) constants of a block; rows `whole` and `whole` + 1 are the delay in whole samples and what is beyond.
        m: (MEMORY, n) memory of all joints; the first row holds the samples seen, `ring` is where the ring starts.
        alike: whether all joints have the same whole samples of delay, and have seen as many.
    """
    if alike:
        slot = int(m[0, start]) % RING
        newer = (slot - int(d[whole, 0])) % RING
        older = (newer - 1) % RING
        for i in range(size):
            m[ring + slot, start + i] = u[i]
        for i in range(size):
            k = start + i
            u[i] = m[ring + newer, k] + d[whole + 1, i] * (m[ring + older, k] - m[ring + newer, k])
    else:
        for i in range(size):
            k = start + i
            slot = int(m[0, k]) % RING
            m[ring + slot, k] = u[i]
            newer = slot - int(d[whole, i])
            newer = newer + RING if newer < 0 else newer
            older = newer - 1 if newer > 0 else RING - 1
            u[i] = m[ring + newer, k] + d[whole + 1, i] * (m[ring + older, k] - m[ring + newer, k])
