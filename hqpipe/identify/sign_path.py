"""The most likely signs of a signal of which only the size was recorded."""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)


@njit(cache=True, nogil=True)
def sign_path(size, keep: float, drive):
    """Signs that minimise Σ (s₊ m₊ − keep s m − drive)² over successive samples (Viterbi, two states).

    Args:
        size: (K,) m ≥ 0.
        keep: share of a sample that is left in the next one.
        drive: (K,) what the inputs add from sample k to k + 1; the last one is not used.

    Returns:
        (K,) signs ±1, and the least sum.
    """
    count = size.shape[0]
    came_up = np.zeros(count, np.uint8)  # whether the best way to sample k with sign + came from sign +
    came_down = np.zeros(count, np.uint8)
    up, down = 0.0, 0.0
    for k in range(count - 1):
        then, now = size[k + 1], keep * size[k]
        uu = up + (then - now - drive[k]) ** 2
        du = down + (then + now - drive[k]) ** 2
        ud = up + (-then - now - drive[k]) ** 2
        dd = down + (-then + now - drive[k]) ** 2
        came_up[k + 1] = uu <= du
        came_down[k + 1] = ud < dd
        up, down = min(uu, du), min(ud, dd)
    signs = np.empty(count)
    positive = up <= down
    for k in range(count - 1, -1, -1):
        signs[k] = 1.0 if positive else -1.0
        positive = came_up[k] == 1 if positive else came_down[k] == 1
    return signs, min(up, down)
