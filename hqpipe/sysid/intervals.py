"""95 % intervals from residuals that are correlated in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hqpipe.sysid.problem import LOWER, UPPER
from hqpipe.sysid.windows import Windows

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


class Clustered(Protocol):
    """Normal equations window by window: `Evaluation` of any fit over windows."""

    @property
    def hessians(self) -> np.ndarray:
        """(W, P, P)."""

    @property
    def scores(self) -> np.ndarray:
        """(W, P)."""


def uncertainty(at: Clustered, windows: Windows, free: np.ndarray) -> Uncertainty:
    """Sandwich estimate for the free coefficients.

    Residuals within a window may be correlated in any way (clustered by window, all joints together), and
    neighbouring windows of one trial too: Bartlett weights with the lag of Newey and West (1994),
    ⌊4 (W/100)^(2/9)⌋. Each window's score is corrected for its leverage (CR3, Bell and McCaffrey 2002), and
    the degrees of freedom follow Satterthwaite: few windows that decide a coefficient widen its interval.

    Args:
        at: normal equations at the solution. windows: those of the fit. free: (P,) bool.
    """
    curvature = at.hessians.sum(axis=0)[np.ix_(free, free)]
    unit = np.sqrt(np.maximum(np.diag(curvature), 1e-300))  # the coefficients differ by many powers of ten
    bread = np.linalg.pinv(curvature / np.outer(unit, unit), rcond=1e-14, hermitian=True)
    own = at.hessians[:, free][:, :, free] / np.outer(unit, unit)
    scores = (at.scores[:, free] - at.scores[:, free].mean(axis=0)) / unit
    scores = np.linalg.solve(np.eye(len(unit)) - own @ bread, scores[:, :, None])[:, :, 0]
    count = len(scores)
    meat = scores.T @ scores
    lags = min(int(4.0 * (count / 100.0) ** (2.0 / 9.0)), count - 1)
    weights = 1.0 - np.arange(1, lags + 1) / (lags + 1.0)
    for lag, weight in enumerate(weights, start=1):
        together = windows.trial[lag:] == windows.trial[:-lag]
        cross = scores[lag:][together].T @ scores[:-lag][together]
        meat += weight * (cross + cross.T)
    share = np.diagonal(bread @ own @ bread, axis1=1, axis2=2)
    freedom = share.sum(axis=0) ** 2 / (share**2).sum(axis=0) / (1.0 + 2.0 * (weights**2).sum())
    full, spread = np.zeros((len(free), len(free))), np.zeros(len(free))
    full[np.ix_(free, free)] = bread @ meat @ bread / np.outer(unit, unit)
    spread[free] = freedom
    return Uncertainty(full, spread)
