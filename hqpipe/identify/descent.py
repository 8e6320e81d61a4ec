"""Levenberg–Marquardt within bounds (Marquardt 1963): the one loop that every least-squares fit runs.

A problem says what a point costs, and gives the sensitivities there in a form of its own: a dense Jacobian of differences that
is followed along the steps (`hqpipe.identify.least_squares`), or exact normal equations window by window
(`hqpipe.identify.paper_model.problem`). Damping, bounds and the rule that ends a fit are the same for all.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

SLOW = 0.01  # of the cost, per step: below it a fit is near a minimum, and of several starts the best one is known
LEAST_DAMPING, DAMPING, MOST_DAMPING = 1e-9, 1e-3, 1e6
ROUNDS = 40  # of differences; assumption: a fit that needs more does not converge
FAILURES = 3
"""Steps in a row that do not help, after which sensitivities that were followed from earlier ones are taken anew. MINPACK's
hybrd allows 2; with 3 the fits of four joints took 5 % fewer predictions and ended as low."""
_TRIALS = 100  # steps between two sets of differences, or of a fit with exact sensitivities; assumption likewise


class Point(Protocol):
    """Values (P,) of all parameters, and what they cost: infinite where the prediction overflows."""

    values: np.ndarray
    cost: float


class Problem(Protocol):
    """What is minimised.

    Attributes:
        free: (F,) indices of the free parameters. low, high: (P,) bounds.
        exact: whether `followed` gives the sensitivities of the new point itself, so that none have to be taken anew.
    """

    free: np.ndarray
    low: np.ndarray
    high: np.ndarray
    exact: bool

    def at(self, values: np.ndarray, last: Any) -> Any:
        """The point (P,) that a step from the point `last` leads to."""
        ...

    def slopes(self, point: Any) -> Any:
        """Sensitivities at a point."""
        ...

    def followed(self, slopes: Any, last: Any, now: Any) -> Any:
        """Those after a step from one point to another that helped."""
        ...

    def equations(self, slopes: Any, point: Any) -> tuple[np.ndarray, np.ndarray]:
        """(F, F) normal matrix and (F,) slope of half the cost in the free parameters."""
        ...


def descended(
    problem: Problem, point: Any, least: float, rounds: int = ROUNDS, most: float = MOST_DAMPING
) -> tuple[Any, Any]:
    """The point from which no step helps, and the sensitivities there, as they were taken last.

    Args:
        point: where the fit begins, of a finite cost. least: share of the cost that a step, or a round of steps with
            sensitivities that follow from the first ones, must bring for the fit to go on.
        rounds: how often sensitivities are taken. most: damping beyond which no step is tried.
    """
    damping = DAMPING
    for _ in range(rounds):
        before = point.cost
        slopes = taken = problem.slopes(point)
        equations = problem.equations(slopes, point)
        failures = 0
        for _ in range(_TRIALS):
            if damping > most:
                break
            values = stepped(*equations, point.values, problem.free, problem.low, problem.high, damping)
            trial = problem.at(values, point)
            if trial.cost < point.cost:
                failures = 0
                last, point, damping = point, trial, max(damping / 10.0, LEAST_DAMPING)
                slopes = problem.followed(slopes, last, point)
                taken = slopes if problem.exact else taken
                if last.cost - point.cost <= least * last.cost:
                    break
                equations = problem.equations(slopes, point)
                continue
            failures += 1
            if slopes is not taken and failures >= FAILURES:
                break
            damping *= 10.0
        if problem.exact or before - point.cost <= least * before:
            break
    return point, taken


def stepped(
    normal: np.ndarray,
    slope: np.ndarray,
    values: np.ndarray,
    free: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    damping: float,
) -> np.ndarray:
    """(P,) values after a damped Gauss-Newton step within the bounds.

    Args:
        normal: (F, F). slope: (F,) of half the cost. values, low, high: (P,). free: (F,) indices.
        damping: in units of the diagonal of `normal`.
    """
    diagonal = normal.diagonal()
    moves = np.flatnonzero(~stopped(slope, values[free], low[free], high[free]) & (diagonal > 0.0))
    if not len(moves):
        return values
    scale = np.sqrt(diagonal[moves])
    part = normal[moves[:, None], moves] / scale / scale[:, None]
    part.flat[:: len(moves) + 1] += damping
    trial = values.copy()
    trial[free[moves]] -= np.linalg.solve(part, slope[moves] / scale) / scale
    return np.minimum(np.maximum(trial, low), high)


def stopped(slope: np.ndarray, now: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(F,) whether a parameter is at a bound that it would pass on the way down.

    Args:
        slope: (F,) of half the cost. now, low, high: (F,) the parameters and their bounds.
    """
    return ((now <= low) & (slope > 0.0)) | ((now >= high) & (slope < 0.0))
