"""The plainest block: one signal beside another."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True, inline="always")
def added(signal: float, value: float) -> float:
    """Their sum."""
    return signal + value
