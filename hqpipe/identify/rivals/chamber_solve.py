"""Levenberg-Marquardt within bounds for the two-chamber model."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.rivals.chamber_problem import ChamberProblem

_MOST_STEPS = 40
_TOLERANCE = 1e-5  # relative fall of the cost; the intervals are wider by far
_DAMPING, _DAMPING_MAX = 1e-3, 1e6


def solve_chambers(
    problem: ChamberProblem, x: np.ndarray, free: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, NormalEquations]:
    """Minimise the cost over the free parameters.

    Args:
        x: (P,) first guess; parameters that are not free keep their value. free: (P,) bool.
        lower, upper: (P,) bounds.

    Returns:
        (P,) parameters and the normal equations there.
    """
    x = np.clip(x, lower, upper)
    at, damping = problem.evaluate(x, free), _DAMPING
    for _ in range(_MOST_STEPS):
        fall = np.inf
        while damping <= _DAMPING_MAX:
            moved = np.clip(x + at.step(x, free, lower, upper, damping), lower, upper)
            cost = problem.cost(moved)
            if np.isfinite(cost) and cost < at.cost:
                fall = at.cost - cost
                break
            damping *= 10.0
        if not np.isfinite(fall):
            return x, at
        x, enough = moved, fall <= _TOLERANCE * at.cost
        at, damping = problem.evaluate(x, free), max(damping / 10.0, 1e-9)
        if enough:
            return x, at
    return x, at
