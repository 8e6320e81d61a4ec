"""The error on data that a fit has not seen, from the slopes of one fit to all of them.

Each group of fit samples is left out in turn; the numbers move by the step that least squares would take without it (Allen's
PRESS, 1974, for groups). Exact where the model is linear in its numbers; elsewhere to first order.
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.model import Samples
from hqpipe.identify.sampling import blocks

_GROUPS = 5  # as five-fold cross-validation; where there are fewer trials each is cut into parts
_LEAST_TRIALS = 3
_SINGULAR = 1e-9  # of the largest eigenvalue: a number that the other groups do not show stays as it is


def left_out_square(fitter: Fitter, solution: Solution) -> float:
    """Sum of the squared errors of every group, predicted from the others; infinite where the prediction overflows."""
    if not np.isfinite(solution.square):
        return np.inf
    jacobian, error, free = solution.jacobian, solution.error, solution.free
    spread = fitter.spread[free]
    noise = solution.square / max(len(error), 1)
    prior = np.where(np.isfinite(spread), noise / spread**2, 0.0)
    normal = jacobian.T @ jacobian + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    total = 0.0
    group = groups(fitter.model.fit)
    for number in np.unique(group):
        here = group == number
        mine = jacobian[here] / scale
        rest = normal / np.outer(scale, scale) - mine.T @ mine
        step = np.linalg.lstsq(rest, mine.T @ error[here], rcond=_SINGULAR)[0]
        predicted = error[here] + mine @ step
        total += float(predicted @ predicted)
    return total


def groups(samples: Samples) -> np.ndarray:
    """(N,) number of the group of each sample: its trial, or a part of it where there are few."""
    if len(np.unique(samples.trial)) >= _LEAST_TRIALS:
        return samples.trial
    longest = max(int(np.bincount(samples.trial).max()), 1) if len(samples.trial) else 1
    return blocks(samples, longest / _GROUPS)
