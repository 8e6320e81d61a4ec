"""95 % intervals from residuals that are correlated in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.paper_model.problem import LOWER, UPPER

LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance (P, P) of the coefficients, and degrees of freedom (P,) of its diagonal; 0 if not free."""

    covariance: np.ndarray
    freedom: np.ndarray

    def interval(
        self, k: np.ndarray, lower: np.ndarray = LOWER, upper: np.ndarray = UPPER
    ) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends (P,) of the 95 % intervals around `k`, cut to the physical bounds."""
        from scipy.special import stdtrit

        quantile = stdtrit(np.maximum(self.freedom, 1.0), 0.5 + LEVEL / 2.0)
        half = quantile * np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.maximum(k - half, lower), np.minimum(k + half, upper)


def uncertainty(at: NormalEquations, free: np.ndarray) -> Uncertainty:
    """Sandwich estimate for the free coefficients.

    Residuals within a window may be correlated in any way (clustered by window, all joints together), and so may those of
    windows: the variance of the sum of all scores is read off the B lowest cosines of their sequence, B = ⌊0.4 W^(2/3)⌋ for
    W windows but no fewer than there are coefficients (Lazarus, Lewis, Stock and Watson, J. Bus. Econ. Stat. 36, 2018).
    Each window's score is corrected for its leverage (CR3, Bell and McCaffrey 2002), and the degrees of freedom follow
    Satterthwaite: B where all windows tell as much, fewer where few decide a coefficient.

    Args:
        at: normal equations at the solution, windows in the order of time. free: (P,) bool.
    """
    curvature = at.hessians.sum(axis=0)[np.ix_(free, free)]
    unit = np.sqrt(np.maximum(np.diag(curvature), 1e-300))  # the coefficients differ by many powers of ten
    bread = np.linalg.pinv(curvature / np.outer(unit, unit), rcond=1e-14, hermitian=True)
    own = at.hessians[:, free][:, :, free] / np.outer(unit, unit)
    scores = (at.scores[:, free] - at.scores[:, free].mean(axis=0)) / unit
    scores = np.linalg.solve(np.eye(len(unit)) - own @ bread, scores[:, :, None])[:, :, 0]
    waves = _cosines(len(scores), len(unit))
    sums = waves @ scores
    share = np.diagonal(bread @ own @ bread, axis1=1, axis2=2)
    expected = np.einsum("bw,wp,cw->pbc", waves, share, waves)  # of the sums' products, were the windows independent
    freedom = np.trace(expected, axis1=1, axis2=2) ** 2 / np.maximum((expected**2).sum(axis=(1, 2)), 1e-300)
    full, spread = np.zeros((len(free), len(free))), np.zeros(len(free))
    full[np.ix_(free, free)] = bread @ (sums.T @ sums / len(waves)) @ bread / np.outer(unit, unit)
    spread[free] = freedom
    return Uncertainty(full, spread)


def _cosines(count: int, least: int) -> np.ndarray:
    """(B, W) lowest cosines over `count` windows, at least `least` of them, each with mean 0 and mean square 1."""
    waves = max(min(max(int(0.4 * count ** (2.0 / 3.0)), least), count - 1), 1)
    phase = np.pi * (np.arange(count) + 0.5) / count
    return np.sqrt(2.0) * np.cos(np.arange(1, waves + 1)[:, None] * phase)
