"""Torque that depends on the way since the last reversal: an elastic element with a slip limit (Prandtl; Jenkin)."""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)


@njit(cache=True, nogil=True)
def slipping_spring(position: np.ndarray, slip: float) -> np.ndarray:
    """(T,) deflection −1 … 1 of a spring that slips when it is deflected by `slip`; 0 at the first sample.

    Args:
        position: (T,) rad or m. slip: likewise, above 0.
    """
    found = np.zeros(len(position))
    for k in range(1, len(position)):
        found[k] = min(max(found[k - 1] + (position[k] - position[k - 1]) / slip, -1.0), 1.0)
    return found
