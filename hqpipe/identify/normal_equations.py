"""Normal equations of a fit over windows, and the damped step that they ask for."""

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

    def step(self, x: np.ndarray, free: np.ndarray, lower: np.ndarray, upper: np.ndarray, damping: float) -> np.ndarray:
        """(P,) damped Gauss-Newton step; a parameter that its gradient presses against a bound stays there.

        Args:
            x: (P,) the point. free: (P,) bool. lower, upper: (P,) bounds.
            damping: of Levenberg-Marquardt, in units of the diagonal.
        """
        gradient, hessian = self.gradient, self.hessian
        pressed = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))
        active = free & ~pressed & (np.diag(hessian) > 0)
        step = np.zeros(len(x))
        if active.any():
            unit = np.sqrt(np.diag(hessian)[active])
            scaled = hessian[np.ix_(active, active)] / np.outer(unit, unit) + damping * np.eye(len(unit))
            step[active] = -np.linalg.lstsq(scaled, gradient[active] / unit, rcond=1e-14)[0] / unit
        return step
