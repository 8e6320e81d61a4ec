"""From which size on a residual is a gross error, whose weight in a fit is bounded (Huber 1964)."""

from __future__ import annotations

import numpy as np

_SIGMAS = 6.0  # assumption: only gross errors lie beyond; a Gaussian passes it twice in 10⁹ samples
_SHARE = 0.5  # of the RMS; keeps impacts from counting as gross where most of a log is at rest
_GAUSSIAN = 1.4826  # standard deviation over median absolute deviation of a normal distribution


def outlier_size(residual: np.ndarray) -> float:
    """Size from which on the residuals (S,) of a first fit count as gross errors, N·m."""
    spread = _GAUSSIAN * np.median(np.abs(residual - np.median(residual)))
    return float(max(_SIGMAS * spread, _SHARE * np.sqrt(np.mean(residual**2)), 1e-12))


def huber(residual: np.ndarray, outlier: float) -> np.ndarray:
    """(S,) whose square is the loss of Huber (1964): linear in the residuals (S,) beyond `outlier`."""
    size = np.abs(residual)
    gross = size > outlier
    found = residual.copy()
    found[gross] = np.sign(residual[gross]) * np.sqrt(outlier * (2.0 * size[gross] - outlier))
    return found
