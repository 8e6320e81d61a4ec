"""Linear least squares over regressors: plain, robust, and with errors that hold for correlated residuals."""

from __future__ import annotations

import numpy as np

HUBER = 1.345  # of the scale: 95 % efficiency for normal errors (Huber 1964)
NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation, of normal errors
TURNS = 6  # of Huber's weights; assumption: a start of a search needs no more
MOST_ROWS = 5_000  # of a robust fit, evenly spaced: a first fit needs no more


def least_squares(x: np.ndarray, y: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """(K,) by normal equations on columns of equal size; the shortest solution where columns depend on each other.

    Args:
        x: (N, K). y: (N,). weights: (N,) of the squared errors.
    """
    scale = np.sqrt(np.mean(x**2, axis=0))
    scale[scale == 0.0] = 1.0
    x = x / scale
    left = x if weights is None else x * weights[:, None]
    return np.linalg.lstsq(left.T @ x, left.T @ y, rcond=1e-11)[0] / scale


def robust_fit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(K,) by Huber's weights, iterated."""
    every = -(-len(y) // MOST_ROWS)
    x, y = x[::every], y[::every]
    found = least_squares(x, y)
    for _ in range(TURNS):
        residual = np.abs(y - x @ found)
        scale = NORMAL_MAD * np.median(residual)
        if not scale > 0.0:
            break
        found = least_squares(x, y, np.minimum(1.0, HUBER * scale / np.maximum(residual, 1e-300)))
    return found


def standard_errors(x: np.ndarray, residual: np.ndarray, block: np.ndarray) -> np.ndarray:
    """(K, K) covariance of the coefficients that holds for residuals correlated within blocks (Liang & Zeger 1986).

    Args:
        x: (N, K). residual: (N,). block: (N,) non-decreasing numbers of stretches longer than the correlation.
    """
    scale = np.sqrt(np.mean(x**2, axis=0))
    scale[scale == 0.0] = 1.0
    x = x / scale
    inverse = np.linalg.pinv(x.T @ x, rcond=1e-11, hermitian=True)
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    scores = np.add.reduceat(x * residual[:, None], starts, axis=0)
    count = len(starts)
    middle = scores.T @ scores * (count / max(1, count - x.shape[1]))
    return inverse @ middle @ inverse / np.outer(scale, scale)


def blocks(segment: np.ndarray, time: np.ndarray, span: float) -> np.ndarray:
    """(N,) numbers of stretches of `span` s within segments."""
    part = np.floor(time / span).astype(np.int64)
    change = (np.diff(segment, prepend=segment[:1]) != 0) | (np.diff(part, prepend=part[:1]) != 0)
    return np.cumsum(change)
