"""The fit of the paper's four coefficients over windows of one or several joints, with exact sensitivities.

The torque at which a window starts is known from the log only to within its noise: it is free, and eliminated window by window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.descent import SLOW, descended
from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.paper_model.window_fit import UNKNOWNS, accumulate, one_step_moments
from hqpipe.identify.windows import JointData, Windows

COEFFICIENTS = ("k1", "k2", "k3", "k4")
LOWER = np.zeros(4)  # physics: no term of eq. (7) may act against its meaning
UPPER = np.array([np.inf, 1.0, np.inf, np.inf])  # a share of the torque leaks away in a sample
HELD = 1e9  # start weight that holds a window's start to the log
DROWNED = 1e-12  # of what a window says of a coefficient: less, once its start is eliminated, is rounding
_SPANS = (1, 5, 20)  # samples of the differences that starts are made of
_LEAST = 1e-9  # of the cost, per step: exact sensitivities end a fit in few steps more than a coarse rule


@dataclass(frozen=True, eq=False)
class Solution:
    """A point of a fit, and where it ended.

    Attributes:
        values: (4,) coefficients. starts: (W,) start torques per joint. at: normal equations in the coefficients there,
            after elimination of the start torques. cost: of `at`; infinite where the model runs away within a window.
        blocks: per joint, what the elimination needs to find the start torques again.
    """

    values: np.ndarray
    starts: list[np.ndarray]
    at: NormalEquations
    cost: float
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]


class Problem:
    """Joints that share one set of coefficients; the start torque of every window is a free nuisance.

    Args:
        joints: data of each joint.
        windows: the same for every joint.
        radius: (J,) sprocket radius R, m.
        limit: (J,) effort limit, N·m.
    """

    low, high, exact = LOWER, UPPER, True  # as `hqpipe.identify.descent` asks for them

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
        self.free = np.arange(len(COEFFICIENTS))

    def fit(self, free: np.ndarray, starts: Sequence[np.ndarray], torques: list[np.ndarray] | None = None) -> Solution:
        """Minimise the cost over the free coefficients within their bounds, and over the start torques.

        Near from every start, then to the end from the best, as `hqpipe.identify.least_squares` does.

        Args:
            free: (4,) bool. starts: of (4,); what is not free stays there.
            torques: (W,) start torques per joint to begin with; those of the log if not given.

        Returns:
            A start that runs away within a window if all of them do.
        """
        self.free = np.flatnonzero(free)
        points = [self._point(k, self.measured_starts() if torques is None else torques) for k in starts]
        sound = [point for point in points if np.isfinite(point.cost)]
        if not sound:
            return points[0]
        near = [descended(self, point, SLOW)[0] for point in sound] if len(sound) > 1 else sound
        return descended(self, min(near, key=lambda point: point.cost), _LEAST)[0]

    def starts(self, free: np.ndarray) -> list[np.ndarray]:
        """(4,) coefficients from differences over a few samples, the best in the free run first; what is not free is 0.

        Args:
            free: (4,) bool.
        """
        spans = [span for span in _SPANS if span <= self.windows.samples // 2] or [1]
        guesses = [np.where(free, self.one_step(span), 0.0) for span in spans]
        costs = [self._point(guess, self.measured_starts()).cost for guess in guesses]
        if min(costs) == np.inf:  # k4 large enough to make the free run diverge
            return [np.where(np.arange(4) == COEFFICIENTS.index("k4"), 0.0, guesses[-1])]
        return [guess for _, guess in sorted(zip(costs, guesses, strict=True), key=lambda pair: pair[0])]

    def at(self, values: np.ndarray, last: Solution) -> Solution:
        """The point after a step, the start torques moved along with the coefficients; see `descent.Problem`."""
        step, pairs = values - last.values, zip(last.starts, last.blocks, strict=True)
        return self._point(values, [start - (offset + ratio @ step) for start, (ratio, offset) in pairs])

    def slopes(self, point: Solution) -> NormalEquations:
        return point.at

    def followed(self, slopes: NormalEquations, last: Solution, now: Solution) -> NormalEquations:
        return now.at

    def equations(self, slopes: NormalEquations, point: Solution) -> tuple[np.ndarray, np.ndarray]:
        return slopes.hessian[np.ix_(self.free, self.free)], slopes.gradient[self.free]

    def _point(self, k: np.ndarray, starts: list[np.ndarray]) -> Solution:
        with np.errstate(over="ignore", invalid="ignore"):
            at, blocks = self.evaluate(k, starts)
        return Solution(k, starts, at, at.cost if at.sound() else np.inf, blocks)

    def measured_starts(self) -> list[np.ndarray]:
        """(W,) logged torque at the start of every window, per joint."""
        return [data.effort[self.windows.bounds[:, 0]].copy() for data in self.joints]

    def evaluate(
        self, k: np.ndarray, starts: list[np.ndarray]
    ) -> tuple[NormalEquations, tuple[tuple[np.ndarray, np.ndarray], ...]]:
        """Normal equations at the coefficients `k` (4,) and start torques (W,) per joint, and how these follow a step."""
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
                data.weight,
            )
            unit = np.append(self.scale[j], 1.0)
            a *= unit[:, None] * unit
            g *= unit
            ratio = a[:, :4, 4] / a[:, 4, 4, None]
            left, score = a[:, :4, :4] - a[:, :4, 4, None] * ratio[:, None, :], g[:, :4] - ratio * g[:, 4, None]
            known, kept = (np.diagonal(matrix[:, :4, :4], axis1=1, axis2=2) for matrix in (a, left))
            # In a chaotic window the end hangs on nothing but the start.
            drowned = (kept < DROWNED * known).any(axis=1)
            left[drowned], score[drowned] = 0.0, 0.0
            hessians += left
            scores += score
            total += cost.sum()
            blocks.append((ratio, g[:, 4] / a[:, 4, 4]))
        return NormalEquations(float(total), hessians, scores), tuple(blocks)

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
            means = [
                np.array(
                    [_weighted_mean(r[a + 1 : b + 1] ** 2, d.weight[a + 1 : b + 1]) for a, b in self.windows.bounds]
                )
                for d, r in zip(self.joints, self._residuals, strict=True)
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
            m, r = one_step_moments(data.effort, data.error, data.velocity, data.weight, bounds, span)
            moments += self.scale[j][:, None] * self.scale[j] * m
            right += self.scale[j] * r
        return bounded_least_squares(moments, right, LOWER, UPPER)


def _weighted_mean(values: np.ndarray, weight: np.ndarray) -> float:
    """0 where nothing counts."""
    counts = (weight > 0.0) & ~np.isnan(values)  # no residual where a window says nothing
    return float(values[counts] @ weight[counts] / weight[counts].sum()) if counts.any() else 0.0


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
        if free.all():
            return x  # no bound matters
        cost = 0.5 * x @ moments @ x - right @ x
        if cost < best_cost:
            best, best_cost = x, cost
    return best
