"""Normal equations of a fit, window by window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton matrices at one point, summed over joints; P parameters, W windows.

    Attributes:
        cost: sum of (robust) squared residuals, (N·m)².
        hessians: (W, P, P) Gauss-Newton matrices, window by window (all joints of one window belong together).
        scores: (W, P) gradients likewise.
    """

    cost: float
    hessians: np.ndarray
    scores: np.ndarray

    @property
    def hessian(self) -> np.ndarray:
        return self.hessians.sum(axis=0)

    @property
    def gradient(self) -> np.ndarray:
        return self.scores.sum(axis=0)

    def sound(self) -> bool:
        """Whether every number is finite: the model did not run away within a window."""
        return bool(np.isfinite(self.cost) and np.isfinite(self.hessian).all() and np.isfinite(self.gradient).all())

    @classmethod
    def of(
        cls, jacobian: np.ndarray, error: np.ndarray, window: np.ndarray, count: int, free: np.ndarray
    ) -> NormalEquations:
        """Those of a dense fit.

        Args:
            jacobian: (N, F) of the error. error: (N,). window: (N,) number of each sample's window, below `count`.
            free: (P,) bool, which parameters the columns belong to; the others have 0.
        """
        size, index = len(free), np.flatnonzero(free)
        hessians, scores = np.zeros((count, size, size)), np.zeros((count, size))
        for a, i in enumerate(index):
            scores[:, i] = np.bincount(window, jacobian[:, a] * error, count)
            for b, j in enumerate(index[: a + 1]):
                hessians[:, i, j] = hessians[:, j, i] = np.bincount(window, jacobian[:, a] * jacobian[:, b], count)
        return cls(float(error @ error), hessians, scores)
