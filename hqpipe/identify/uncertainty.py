"""The covariance of fitted parameters from errors that are correlated in time: the one estimator of all intervals."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from hqpipe.identify.determined import MOST_OF_ONE
from hqpipe.identify.normal_equations import NormalEquations

LEVEL = 0.95
NORMAL = NormalDist().inv_cdf(0.5 + LEVEL / 2.0)  # half width of a 95 % interval over the deviation
_SINGULAR = 1e-14  # of the largest eigenvalue, below which a direction is rounding


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance (P, P) of the parameters, and degrees of freedom (P,) of its diagonal; 0 if not free."""

    covariance: np.ndarray
    freedom: np.ndarray

    @property
    def half_widths(self) -> np.ndarray:
        """(P,) of the 95 % intervals."""
        return student(self.freedom) * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def interval(self, values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends (P,) of the 95 % intervals around `values`, cut to the bounds (P,)."""
        return np.maximum(values - self.half_widths, lower), np.minimum(values + self.half_widths, upper)


def student(freedom: np.ndarray | float) -> np.ndarray:
    """Half width of a 95 % interval over the standard deviation, for some degrees of freedom; fewer than one count as one."""
    from scipy.special import stdtrit

    return stdtrit(np.maximum(freedom, 1.0), 0.5 + LEVEL / 2.0)


def uncertainty(at: NormalEquations, free: np.ndarray, prior: np.ndarray | None = None) -> Uncertainty:
    """Sandwich estimate for the free parameters.

    Residuals within a window may be correlated in any way (clustered by window, all joints together), and so may those of
    windows: the variance of the sum of all scores is read off the B lowest cosines of their sequence, B = ⌊0.4 W^(2/3)⌋ for
    W windows but no fewer than there are parameters (Lazarus, Lewis, Stock and Watson, J. Bus. Econ. Stat. 36, 2018).
    Each window's score is corrected for its leverage (CR3, Bell and McCaffrey 2002), up to that of `MOST_OF_ONE`, and the
    degrees of freedom follow Satterthwaite: B where all windows tell as much, fewer where few decide a parameter.

    Args:
        at: normal equations at the solution, windows in the order of time. free: (P,) bool.
        prior: (2, P) curvature of a prior in the units of `at`, and the variance of its slope; none if not given.
    """
    curvature = at.hessians.sum(axis=0)[np.ix_(free, free)]
    known, slope = np.zeros((2, int(free.sum()))) if prior is None else prior[:, free]
    unit = np.sqrt(np.maximum(np.diag(curvature) + known, 1e-300))  # the parameters differ by many powers of ten
    scale = np.outer(unit, unit)
    root = _inverse_root((curvature + np.diag(known)) / scale)
    own = root @ (at.hessians[:, free][:, :, free] / scale) @ root  # (W, F, F) leverage of each window
    scores = (at.scores[:, free] - at.scores[:, free].mean(axis=0)) / unit @ root
    share, axes = np.linalg.eigh(own)
    freed = 1.0 / (1.0 - np.clip(share, 0.0, MOST_OF_ONE))
    along = freed * (scores[:, None] @ axes)[:, 0]
    scores = (axes @ along[:, :, None])[:, :, 0]
    waves = _cosines(len(scores), len(unit))
    sums = waves @ scores
    told = np.diagonal(root @ own @ root, axis1=1, axis2=2)
    expected = (told.T[:, None] * waves) @ waves.T  # (F, B, B) of the sums' products, were the windows independent
    freedom = np.trace(expected, axis1=1, axis2=2) ** 2 / np.maximum((expected**2).sum(axis=(1, 2)), 1e-300)
    inner = sums.T @ sums / len(waves) + root @ np.diag(slope / unit**2) @ root
    full, spread = np.zeros((len(free), len(free))), np.zeros(len(free))
    full[np.ix_(free, free)] = root @ inner @ root / scale
    spread[free] = freedom
    return Uncertainty(full, spread)


def _inverse_root(matrix: np.ndarray) -> np.ndarray:
    """(F, F) symmetric root of the pseudo-inverse."""
    values, vectors = np.linalg.eigh(matrix)
    told = values > _SINGULAR * values.max(initial=0.0)
    return (vectors * np.where(told, 1.0 / np.sqrt(np.where(told, values, 1.0)), 0.0)) @ vectors.T


def _cosines(count: int, least: int) -> np.ndarray:
    """(B, W) lowest cosines over `count` windows, at least `least` of them, each with mean 0 and mean square 1."""
    waves = max(min(max(int(0.4 * count ** (2.0 / 3.0)), least), count - 1), 1)
    phase = np.pi * (np.arange(count) + 0.5) / count
    return np.sqrt(2.0) * np.cos(np.arange(1, waves + 1)[:, None] * phase)
