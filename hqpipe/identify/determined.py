"""Which parameters of a fit its logs determine, from the Gauss-Newton matrices of the windows."""

from __future__ import annotations

import numpy as np

MAX_INFLATION = 1e6  # variance inflation beyond which two coefficients cannot be told apart
MOST_OF_ONE = 0.9  # assumption: with more in one window, intervals, which divide by the rest, come to be rounding
_SINGULAR = 1e-16  # smallest eigenvalue of a correlation matrix that rounding leaves meaningful


def single_window(hessians: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) share of what is known of a parameter that rests on a single window, where it exceeds `MOST_OF_ONE`; 0 elsewhere.

    What is known is the inverse of the variance. With a window gone all free parameters are unknown, so that one which
    alone tells two parameters apart counts as well. Those found are taken for known in what is claimed of the others, which
    are looked at again: nothing may be claimed that follows only from holding what a single window decides.

    Args:
        hessians: (W, P, P) Gauss-Newton matrices of the windows. free: (P,) bool.
    """
    found = np.zeros(len(free))
    if not free.any():
        return found
    total = hessians.sum(axis=0)[np.ix_(free, free)]
    unit = np.sqrt(np.maximum(np.diag(total), 1e-300))
    total = total / np.outer(unit, unit)
    without = _variances(total - hessians[:, free][:, :, free] / np.outer(unit, unit)).max(axis=0)
    lone = np.zeros(len(unit))
    while (claimed := lone == 0.0).any():
        share = np.zeros(len(unit))
        share[claimed] = 1.0 - _variances(total[np.ix_(claimed, claimed)]) / without[claimed]
        if (share <= MOST_OF_ONE).all():
            break
        lone = np.where(share > MOST_OF_ONE, share, lone)
    found[free] = lone
    return found


def _variances(information: np.ndarray) -> np.ndarray:
    """(…, P) diagonal of the inverse of matrices (…, P, P) that rounding may have left indefinite."""
    values, vectors = np.linalg.eigh(information)
    return (vectors**2 / np.maximum(values, _SINGULAR)[..., None, :]).sum(axis=-1)


def inflation(hessian: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) variance inflation of the coefficients: infinite without any effect, 0 if not free."""
    found = np.zeros(len(free))
    part = hessian[np.ix_(free, free)]
    diagonal = np.diag(part)
    if not np.isfinite(part).all() or (diagonal <= 0).any():
        found[free] = np.inf
        return found
    unit = np.sqrt(diagonal)
    found[free] = _variances(part / np.outer(unit, unit))
    return found
