"""Levenberg-Marquardt within bounds, for a problem that brings its own normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.paper_model.problem import COEFFICIENTS, LOWER, UPPER, Evaluation, Problem

_MAX_EVALUATIONS = 100
_TOLERANCE = 1e-9  # relative fall of the cost, and relative step
_DAMPING = 1e-3
_DAMPING_MAX = 1e12
_SPANS = (1, 5, 20)  # samples; first guesses, of which the best in the free run is taken


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the solver ended.

    Attributes:
        k: (4,) coefficients. starts: (W,) start torques per joint. at: normal equations there.
        converged: False if it ran out of evaluations.
    """

    k: np.ndarray
    starts: list[np.ndarray]
    at: Evaluation
    converged: bool


def solve(problem: Problem, k: np.ndarray, starts: list[np.ndarray], free: np.ndarray) -> Solution:
    """Minimise the cost over the free coefficients within physical bounds, and over the start torques.

    Args:
        k: (4,) first guess; coefficients that are not free keep their value.
        starts: (W,) start torques per joint.
        free: (4,) bool.
    """
    at = problem.evaluate(k, starts)
    if not at.sound():
        return Solution(k, starts, at, False)  # a guess that runs away within a window
    damping = _DAMPING
    for _ in range(_MAX_EVALUATIONS):
        step = at.step(k, free, LOWER, UPPER, damping)
        moved_k = np.clip(k + step, LOWER, UPPER)
        step = moved_k - k
        pairs = zip(starts, at.blocks, strict=True)
        moved_starts = [s - (offset + ratio @ step) for s, (ratio, offset) in pairs]
        moved = problem.evaluate(moved_k, moved_starts)
        if not moved.sound() or moved.cost > at.cost:
            damping *= 10.0
            if damping > _DAMPING_MAX:
                return Solution(k, starts, at, True)
            continue
        fall = at.cost - moved.cost
        small = np.abs(step) <= _TOLERANCE * np.maximum(np.abs(moved_k), 1e-12)
        k, starts, at = moved_k, moved_starts, moved
        damping = max(damping / 5.0, 1e-12)
        if fall <= _TOLERANCE * at.cost or small.all():
            return Solution(k, starts, at, True)
    return Solution(k, starts, at, False)


def first_guess(problem: Problem, free: np.ndarray) -> np.ndarray:
    """(4,) coefficients from differences over a few samples; free: (4,) bool, the others are 0."""
    starts = problem.measured_starts()
    spans = [span for span in _SPANS if span <= problem.windows.samples // 2] or [1]
    guesses = [np.where(free, problem.one_step(span), 0.0) for span in spans]
    costs = [problem.evaluate(guess, starts).cost for guess in guesses]
    costs = [cost if np.isfinite(cost) else np.inf for cost in costs]
    if min(costs) == np.inf:  # k4 large enough to make the free run diverge
        return np.where(np.arange(4) == COEFFICIENTS.index("k4"), 0.0, guesses[-1])
    return guesses[int(np.argmin(costs))]
