"""Least squares with bounds and weak priors on the free parameters of one joint.

Levenberg–Marquardt (Marquardt 1963) with the sensitivities taken as differences, and followed along the steps between them
(Broyden 1965). A fit is a function of the model, the free parameters and the starts alone. Long differences bring it near,
short ones end it, when a step no longer changes what the logs say of a set of effects.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.descent import SLOW, descended, stopped
from hqpipe.identify.misfit import misfit
from hqpipe.identify.model import JointModel, all_parameters

_STEP = 3e-3  # of the spread: long enough that a stick-slip event which moves by a substep does not decide the slope
_CHANGE = 3.0
"""Size of the error's change, over its root mean square, that the step of a difference is to bring: as a few standard
deviations of the parameter if the errors were white. Longer ones pass over the corners of a limit that the data resolve."""
_SHORTEST = 0.01  # of the long step; assumption: a jump of the error has no slope, however short the step
_TOLERANCE = 1e-5  # of the cost, per step: so small a one lets a weak prior decide where the logs do not
_WORTH = 0.1  # of twice ln B, per step: below it no decision changes; assumption
_PRIOR_HOLDS = 0.5  # of the variance that a prior was weighed with, below which the fit is made again; assumption
_STALE = 1.0  # damping from which on sensitivities that were not taken here are no guide; assumption
_SEEN = 1e-7  # of the size of the error, that a difference must reach to be told from rounding
_UNSTABLE = 1e50  # of the size of the error: a difference so large is on its way to overflow, and no slope


@dataclass(frozen=True, eq=False)
class Solution:
    """A fit.

    Attributes:
        free: (F,) indices of the free parameters. values: (P,) all of them. error: (N,) see `hqpipe.identify.misfit`.
        jacobian: (N, F) of it.
        square: sum of the squared errors.
    """

    free: np.ndarray
    values: np.ndarray
    error: np.ndarray
    jacobian: np.ndarray
    square: float


@dataclass(frozen=True, eq=False)
class _Point:
    """Values (P,), their error (N,) and its cost."""

    values: np.ndarray
    error: np.ndarray
    cost: float


class Fitter:
    """Fits one model again and again; keeps its parameters' bounds and priors as arrays.

    Attributes:
        neutral, spread, low, high: (P,) of all parameters. Bounds hold for what is free.
        within: (P,) whether its bounds say all that is known of a number beforehand.
    """

    def __init__(self, model: JointModel, within: Mapping[int, tuple[float, float]] | None = None) -> None:
        """
        Args:
            within: place of a parameter → bounds that it has here, in place of its own where they are closer.
        """
        self.model = model
        parameters = all_parameters(model)
        self.neutral = np.array([p.neutral for p in parameters], dtype=np.float64)
        self.spread = np.array([p.spread for p in parameters], dtype=np.float64)
        self.low = np.array([p.low for p in parameters], dtype=np.float64)
        self.high = np.array([p.high for p in parameters], dtype=np.float64)
        self.within = np.zeros(len(parameters), dtype=bool)
        for place, ends in (within or {}).items():
            self.low[place], self.high[place] = np.clip(ends, self.low[place], self.high[place])
            self.within[place] = True
        self._idle: Callable[[np.ndarray], Collection[int]] = getattr(model, "idle", lambda values: ())
        # Of its class: a model that wraps another one does not have the sensitivities of that.
        self._sensitivity = getattr(type(model), "sensitivity", lambda model, values, index: None)

    def error(self, values: np.ndarray) -> np.ndarray:
        """(N,) see `hqpipe.identify.misfit`, at the fit samples; infinite where the prediction overflows."""
        with np.errstate(over="ignore", invalid="ignore"):
            found = misfit(self.model, values)
        return found if np.isfinite(found).all() else np.full(len(found), np.inf)

    @np.errstate(over="ignore", invalid="ignore")  # squares of a prediction that grows without bounds
    def fit(
        self,
        free: np.ndarray,
        starts: Sequence[np.ndarray],
        noise: float,
        origin: Solution | None = None,
        known: Solution | None = None,
    ) -> Solution:
        """Fit the free parameters: near a minimum from every start, then into the lowest of them.

        Args:
            free: (F,) indices. starts: of (P,). noise: variance of the errors that is expected; it weighs the priors until the
                errors that are left tell it. origin: a fit from which the starts were made, whose sensitivities serve for the
                first steps; None where there is none.
            known: a fit of the same parameters, which is the result where no start leads lower; None where there is none.
        """
        begun = [self._at(self.clipped(start, free), free, noise) for start in starts]
        near = [] if known is None else [(self._at(known.values, free, noise), known.jacobian)]
        for point in begun:
            if np.isfinite(point.cost):
                near.append(self._near(point, free, noise, origin, near))
        if not near:
            none = np.zeros((len(begun[0].error), len(free)))
            return Solution(free, begun[0].values, begun[0].error, none, np.inf)
        point, jacobian = min(near, key=lambda found: found[0].cost)
        if known is not None and point is near[0][0]:
            return known
        for _ in range(2):
            noise = _variance(point.error)
            problem = _Differences(self, free, noise, resolved=jacobian)
            point = self._at(point.values, free, noise)
            point, jacobian = descended(problem, point, self._tolerance(point.error))
            if _variance(point.error) >= _PRIOR_HOLDS * noise:
                break
        return Solution(free, point.values, point.error, jacobian, float(point.error @ point.error))

    def clipped(self, values: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(P,) values with the free parameters, (F,) indices, within their bounds."""
        found = values.copy()
        found[free] = np.clip(values[free], self.low[free], self.high[free])
        return found

    def _near(
        self,
        point: _Point,
        free: np.ndarray,
        noise: float,
        origin: Solution | None,
        others: Sequence[tuple[_Point, np.ndarray]],
    ) -> tuple[_Point, np.ndarray]:
        """Where steps lead until they bring little, and the sensitivities on the way there by long differences, taken once.

        Taken more often they cost a sixth of all predictions, and fits end no lower.
        First steps follow the sensitivities of the origin, which cost nothing; where they lead alone does not tell which of
        several minima is the lowest. If that is where another start has led already, nothing else is tried.

        Args:
            others: what earlier starts have led to.
        """
        if origin is not None and np.isfinite(origin.square):
            problem = _Differences(self, free, noise, first=self._first_slopes(point, free, origin))
            point, _ = descended(problem, point, SLOW, 1, _STALE)
        for other, slopes in others:
            apart = slopes @ (point.values - other.values)[free]
            if other.cost <= point.cost and apart @ apart < SLOW * other.cost:
                return other, slopes
        return descended(_Differences(self, free, noise), point, SLOW, rounds=1)

    def _first_slopes(self, point: _Point, free: np.ndarray, origin: Solution) -> np.ndarray:
        """(N, F) sensitivities at a start: those of the origin where it has them, else differences."""
        known = np.isin(free, origin.free)
        rows = np.zeros((len(free), len(point.error)))
        rows[known] = origin.jacobian.T[np.isin(origin.free, free)]
        new = free[~known]
        if len(new):
            rows[~known] = self.jacobian(point.values, point.error, new, self.long_steps(point.values, new)).T
        return rows.T

    def _tolerance(self, error: np.ndarray) -> float:
        """Of the cost, per step, below which a fit ends: less changes the odds of nothing, as errors that stay alike for long
        are worth few samples."""
        return max(_TOLERANCE, _WORTH * correlation_time(error, self.model.fit) / max(len(error), 1))

    def _at(self, values: np.ndarray, free: np.ndarray, noise: float) -> _Point:
        error = self.error(values)
        return _Point(values, error, self._cost(values, error, free, noise))

    def stopped(self, values: np.ndarray, free: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """(F,) whether a parameter is at a bound that it would pass on the way down; `slope`: (F,) of half the cost."""
        return stopped(slope, values[free], self.low[free], self.high[free])

    def jacobian(self, values: np.ndarray, error: np.ndarray, free: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """(N, F) of the error: those that the model gives, else one-sided differences of the length `steps` (F,), within the
        bounds."""
        rows = np.zeros(
            (len(free), len(error))
        )  # the sensitivities to one parameter lie side by side: products are faster
        size = float(np.sqrt(error @ error)) or 1.0
        idle = self._idle(values)
        for k, index in enumerate(free):
            if index in idle:
                continue
            exact = self._sensitivity(self.model, values, int(index))
            if exact is not None:
                rows[k] = exact
                continue
            step = self._within(values, int(index), float(steps[k]))
            for _ in range(4):
                moved = values.copy()
                moved[index] = min(max(values[index] + step, self.low[index]), self.high[index])  # but for rounding
                difference = self.error(moved) - error
                change = float(np.sqrt(difference @ difference))
                if change > _SEEN * size:
                    break
                step = self._within(values, int(index), 10.0 * step)
            # What changes nothing has no slope but that of rounding, and what grows without bounds has none.
            if _SEEN * size < change < _UNSTABLE * size:
                np.divide(difference, step, out=rows[k])
        return rows.T

    def long_steps(self, values: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(F,) long steps for differences: a part of what is known of the size beforehand."""
        return _STEP * np.where(
            np.isfinite(self.spread[free]), self.spread[free], np.maximum(np.abs(values[free]), 1e-3)
        )

    def pull(self, values: np.ndarray, free: np.ndarray, noise: float) -> np.ndarray:
        """(F,) slope of the priors in the cost, beside errors of the variance `noise`."""
        return self._prior(values, free, noise) * (values - self.neutral)[free]

    def precision(self, values: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(F,) one over the variance that each number has beforehand.

        A Cauchy prior is flatter the farther out the value (P,) is, and a number between two bounds varies no more than one
        that is anywhere between them.
        """
        spread, span = self.spread[free], (self.high - self.low)[free]
        sized, bounded = np.isfinite(spread), np.isfinite(span) & (span > 0.0)
        found = np.where(
            sized, 1.0 / np.where(sized, spread, 1.0) ** 2 / (1.0 + self._relative(values, free) ** 2), 0.0
        )
        return found + np.where(bounded, 12.0 / np.where(bounded, span, 1.0) ** 2, 0.0)

    def _resolved(self, jacobian: np.ndarray, error: np.ndarray) -> np.ndarray:
        """(F,) steps that change the error by `_CHANGE` of its root mean square; infinite where nothing changes."""
        size = _CHANGE * np.sqrt(error @ error / len(error))
        slope = np.sqrt(np.sum(jacobian**2, axis=0))
        return np.divide(size, slope, out=np.full(len(slope), np.inf), where=slope > 0.0)

    def _within(self, values: np.ndarray, index: int, step: float) -> float:
        """The step, turned round where it would leave the bounds; up to the farther bound where it would on both sides."""
        up, down = self.high[index] - values[index], values[index] - self.low[index]
        ahead, behind = (up, down) if step > 0.0 else (down, up)
        if abs(step) <= ahead:
            return step
        if abs(step) <= behind:
            return -step
        return float(up if up >= down else -down)

    def _cost(self, values: np.ndarray, error: np.ndarray, free: np.ndarray, noise: float) -> float:
        """Squared errors, and minus twice the logarithm of a Cauchy prior for each effect's parameter."""
        if not np.isfinite(error[:1]).all():
            return np.inf
        return float(error @ error + 2.0 * noise * np.log1p(self._relative(values, free) ** 2).sum())

    def _relative(self, values: np.ndarray, free: np.ndarray) -> np.ndarray:
        """(F,) deviations from neutral over the spread; 0 where nothing is known beforehand."""
        known = np.isfinite(self.spread[free])
        return np.where(known, (values - self.neutral)[free] / np.where(known, self.spread[free], 1.0), 0.0)

    def _prior(self, values: np.ndarray, free: np.ndarray, noise: float) -> np.ndarray:
        """(F,) curvature of the prior."""
        known = np.isfinite(self.spread[free])
        prior = np.zeros(len(free))
        prior[known] = 2.0 * noise / self.spread[free][known] ** 2 / (1.0 + self._relative(values, free)[known] ** 2)
        return prior


class _Differences:
    """The fit of some parameters as `hqpipe.identify.descent` asks for it: sensitivities are differences, followed between."""

    exact = False

    def __init__(
        self,
        fitter: Fitter,
        free: np.ndarray,
        noise: float,
        first: np.ndarray | None = None,
        resolved: np.ndarray | None = None,
    ) -> None:
        """
        Args:
            first: (N, F) sensitivities to begin with; None for differences. resolved: (N, F) sensitivities that say how short
                differences may be; None for long ones.
        """
        self._fitter, self._noise, self._first, self._resolved = fitter, noise, first, resolved
        self.free, self.low, self.high = free, fitter.low, fitter.high
        self._steps = np.zeros(len(free))
        self._squares: tuple[np.ndarray, np.ndarray] | None = None  # sensitivities, and their products

    def at(self, values: np.ndarray, last: _Point) -> _Point:
        return self._fitter._at(values, self.free, self._noise)

    def slopes(self, point: _Point) -> np.ndarray:
        fitter, self._steps = self._fitter, self._fitter.long_steps(point.values, self.free)
        if self._first is not None:
            first, self._first = self._first, None
            return first
        if self._resolved is None:
            return fitter.jacobian(point.values, point.error, self.free, self._steps)
        resolved = fitter._resolved(self._resolved, point.error)
        self._steps = np.clip(resolved, _SHORTEST * self._steps, self._steps)
        self._resolved = fitter.jacobian(point.values, point.error, self.free, self._steps)
        return self._resolved

    def followed(self, slopes: np.ndarray, last: _Point, now: _Point) -> np.ndarray:
        """Sensitivities (N, F) that a step bears out, as near to the last ones as can be (Broyden 1965)."""
        step = (now.values - last.values)[self.free] / self._steps  # by lengths that make the numbers comparable
        missed = now.error - last.error - slopes @ (step * self._steps)
        share = step / (step @ step) / self._steps
        found = slopes + np.outer(share, missed).T
        cross = np.outer(slopes.T @ missed, share)
        self._squares = found, self._products(slopes) + cross + cross.T + missed @ missed * np.outer(share, share)
        return found

    def equations(self, slopes: np.ndarray, point: _Point) -> tuple[np.ndarray, np.ndarray]:
        fitter, free = self._fitter, self.free
        prior = fitter._prior(point.values, free, self._noise)
        slope = slopes.T @ point.error + fitter.pull(point.values, free, self._noise)
        return self._products(slopes) + np.diag(prior), slope

    def _products(self, slopes: np.ndarray) -> np.ndarray:
        """(F, F) of the columns of the sensitivities."""
        if self._squares is None or self._squares[0] is not slopes:
            self._squares = slopes, slopes.T @ slopes
        return self._squares[1]


def lengths(normal: np.ndarray) -> np.ndarray:
    """(F,) lengths of the columns of a normal matrix (F, F); 1 of a column that is nought, so that it can be divided by."""
    squares = np.diag(normal)
    return np.where(squares > 0.0, np.sqrt(np.maximum(squares, 0.0)), 1.0)


def _variance(error: np.ndarray) -> float:
    return float(error @ error) / max(len(error), 1)
