"""The least-squares problem of the paper's four coefficients over windows of one or several joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.windows import JointData, Windows
from hqpipe.machine.loops.window_fit import UNKNOWNS, accumulate, one_step_moments

COEFFICIENTS = ("k1", "k2", "k3", "k4")
LOWER = np.zeros(4)  # physics: no term of eq. (7) may act against its meaning
UPPER = np.array([np.inf, 1.0, np.inf, np.inf])  # a share of the torque leaks away in a sample
HELD = 1e9  # start weight that holds a window's start to the log
DROWNED = 1e-12  # of what a window says of a coefficient: less, once its start is eliminated, is rounding


@dataclass(frozen=True, eq=False)
class Evaluation(NormalEquations):
    """In k1 … k4, after elimination of the start torques.

    Attributes:
        blocks: per joint, what the elimination needs to find the start torques again.
    """

    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]


class Problem:
    """Joints that share one set of coefficients; the start torque of every window is a free nuisance.

    Args:
        joints: data of each joint.
        windows: the same for every joint.
        radius: (J,) sprocket radius R, m.
        limit: (J,) effort limit, N·m.
    """

    def __init__(self, joints: list[JointData], windows: Windows, radius: np.ndarray, limit: np.ndarray) -> None:
        self.joints = joints
        self.windows = windows
        self.limit = limit
        self._radius = radius
        # eq. (7): coefficient → joint-space gain
        self.scale = np.stack([radius**2, np.ones_like(radius), radius**2, radius], axis=1)
        self._residuals = [np.full(len(data.effort), np.nan) for data in joints]
        self.start_weight = np.full(len(joints), HELD)
        self.outlier = np.full(len(joints), np.inf)

    def measured_starts(self) -> list[np.ndarray]:
        """(W,) logged torque at the start of every window, per joint."""
        return [data.effort[self.windows.bounds[:, 0]].copy() for data in self.joints]

    def evaluate(self, k: np.ndarray, starts: list[np.ndarray]) -> Evaluation:
        """Normal equations at the coefficients `k` (4,) and start torques (W,) per joint."""
        count = len(self.windows.bounds)
        total, hessians, scores, blocks = 0.0, np.zeros((count, 4, 4)), np.zeros((count, 4)), []
        for j, data in enumerate(self.joints):
            a, g = np.empty((count, UNKNOWNS, UNKNOWNS)), np.empty((count, UNKNOWNS))
            cost = np.empty(count)
            accumulate(
                k * self.scale[j],
                self.limit[j],
                data.effort,
                data.error,
                data.velocity,
                self.windows.bounds,
                starts[j],
                self.start_weight[j],
                self.outlier[j],
                a,
                g,
                cost,
                self._residuals[j],
                data.observed,
            )
            unit = np.append(self.scale[j], 1.0)
            a *= unit[:, None] * unit
            g *= unit
            ratio = a[:, :4, 4] / a[:, 4, 4, None]
            left, score = a[:, :4, :4] - a[:, :4, 4, None] * ratio[:, None, :], g[:, :4] - ratio * g[:, 4, None]
            known, kept = (np.diagonal(matrix[:, :4, :4], axis1=1, axis2=2) for matrix in (a, left))
            drowned = (kept < DROWNED * known).any(
                axis=1
            )  # the window is chaotic: its end hangs on nothing but its start
            left[drowned], score[drowned] = 0.0, 0.0
            hessians += left
            scores += score
            total += cost.sum()
            blocks.append((ratio, g[:, 4] / a[:, 4, 4]))
        return Evaluation(float(total), hessians, scores, tuple(blocks))

    def alone(self, j: int) -> Problem:
        """The problem of one of the joints by itself."""
        found = Problem([self.joints[j]], self.windows, self._radius[[j]], self.limit[[j]])
        found.start_weight, found.outlier = self.start_weight[[j]], self.outlier[[j]]
        return found

    def residuals(self, k: np.ndarray) -> list[np.ndarray]:
        """Errors of the predicted samples, restarted from the log at every window, per joint, N·m."""
        self.evaluate(k, self.measured_starts())
        return [r[np.isfinite(r)] for r in self._residuals]

    def window_errors(self, k: np.ndarray) -> list[np.ndarray]:
        """(W,) mean squared error of each window, restarted from the log, per joint; infinite where it runs away."""
        with np.errstate(over="ignore", invalid="ignore"):
            self.evaluate(k, self.measured_starts())
            squares = [np.where(d.observed, r**2, 0.0) for d, r in zip(self.joints, self._residuals, strict=True)]
            means = [
                np.array(
                    [x[a + 1 : b + 1].sum() / max(d.observed[a + 1 : b + 1].sum(), 1) for a, b in self.windows.bounds]
                )
                for d, x in zip(self.joints, squares, strict=True)
            ]
        return [np.where(np.isfinite(mean), mean, np.inf) for mean in means]

    def held(self) -> list[np.ndarray]:
        """Errors of the predicted samples if the torque at every window's start stayed, per joint, N·m."""
        bounds = self.windows.bounds
        return [np.concatenate([x[a] - x[a + 1 : b + 1] for a, b in bounds]) for x in (d.effort for d in self.joints)]

    def one_step(self, span: int) -> np.ndarray:
        """(4,) linear least squares over steps of `span` samples within the bounds; 1 is the paper's fit."""
        moments, right = np.zeros((4, 4)), np.zeros(4)
        for j, data in enumerate(self.joints):
            bounds = self.windows.bounds
            m, r = one_step_moments(data.effort, data.error, data.velocity, bounds, span)
            moments += self.scale[j][:, None] * self.scale[j] * m
            right += self.scale[j] * r
        return bounded_least_squares(moments, right, LOWER, UPPER)


def bounded_least_squares(moments: np.ndarray, right: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Minimise ½ xᵀ M x − rᵀ x within bounds, exactly, by trying every set of active bounds (P is small).

    Args:
        moments: (P, P) M. right: (P,) r. lower, upper: (P,).
    """
    size = len(right)
    best, best_cost = np.clip(np.zeros(size), lower, upper), np.inf
    choices = [[None, *(b for b in (lower[i], upper[i]) if np.isfinite(b))] for i in range(size)]
    for index in np.ndindex(*(len(c) for c in choices)):
        pinned = [choices[i][n] for i, n in enumerate(index)]
        free = np.array([value is None for value in pinned])
        x = np.array([0.0 if value is None else value for value in pinned])
        if free.any():
            reduced = moments[np.ix_(free, free)]
            unit = np.sqrt(np.maximum(np.diag(reduced), 1e-300))
            target = (right - moments @ x)[free] / unit
            x[free] = np.linalg.lstsq(reduced / np.outer(unit, unit), target, rcond=1e-12)[0] / unit
        if (x < lower).any() or (x > upper).any():
            continue
        cost = 0.5 * x @ moments @ x - right @ x
        if cost < best_cost:
            best, best_cost = x, cost
    return best
