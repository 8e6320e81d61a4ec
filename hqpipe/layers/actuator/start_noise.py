"""Errors of free runs without the noise of the torque that each window starts from.

A window starts from a logged torque. Its noise ε decays in the run as the torque leaks, a_i = (1 − k2)^i after i samples. So
the errors of a window have the covariance σ² (1 + ρ a aᵀ), where σ² is the variance of the errors and ρ that of ε over it.
Their likelihood is that of independent errors

    r = exp(Σ ln(1 + ρ |a|²) / 2N) (e − c a aᵀ e),   c = (1 − 1/√(1 + ρ |a|²)) / |a|²

(generalised least squares, Aitken 1935; the factor is the determinant of the covariance, summed over the windows of N samples,
with σ at its most likely value). Without it a law that leaks more than the machine would err less, as it forgets ε sooner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

_LEAST = 1e-12  # |a|² below which nothing of the start is left


@dataclass(frozen=True, eq=False)
class StartNoise:
    """The windows of one record.

    Attributes:
        variance: of the noise of the torque's sensor. step: (S,) samples behind the start that are judged. judged: (W, S)
            whether each was recorded.
    """

    variance: float
    step: np.ndarray
    judged: np.ndarray

    def share(self, error: np.ndarray, leak: float) -> float:
        """ρ of errors e (N,) of a law that leaks `leak` of the torque in a sample: the variance of the sensor's noise over that
        of the errors beside ε, which is no smaller where nothing else errs."""
        square = float(error @ error) / max(len(error), 1)
        if not 0.0 < square < np.inf:
            return 0.0
        left = self._left(leak)
        return self.variance / max(square - self.variance * float(np.mean(left**2)), self.variance)

    def removed_from(self, error: np.ndarray, leak: float, share: float) -> np.ndarray:
        """(N,) r of errors e (N,), window by window, of a law that leaks `leak` of the torque in a sample.

        Args:
            share: ρ.
        """
        if share <= 0.0:
            return error
        left = self._left(leak)
        if self._whole:
            windows, square = error.reshape(self.judged.shape), np.full(len(self.judged), left @ left)
        else:
            windows, square = np.zeros(self.judged.shape), self.judged @ left**2
            windows[self.judged] = error
        grown = np.log1p(share * square)
        part = np.divide(-np.expm1(-0.5 * grown), square, out=np.zeros(len(square)), where=square > _LEAST)
        found = np.exp(0.5 * grown.sum() / len(error)) * (windows - np.outer(part * (windows @ left), left))
        return found.ravel() if self._whole else found[self.judged]

    def floor(self, leak: float) -> tuple[float, float]:
        """Root mean square that the noise leaves in e, and in r, of a law that is right."""
        square, count, sd = float(np.sum(self._left(leak) ** 2)), max(len(self.step), 1), self.variance**0.5
        return sd * (1.0 + square / count) ** 0.5, sd * (1.0 + square) ** (0.5 / count)

    @cached_property
    def _whole(self) -> bool:
        return bool(self.judged.all())

    def _left(self, leak: float) -> np.ndarray:
        """(S,) a, what is left of the start at each judged sample."""
        return min(max(1.0 - leak, 0.0), 1.0) ** self.step.astype(np.float64)
