"""The error on data that a fit has not seen, from the slopes of one fit to all of them.

Each group of fit samples is left out in turn; the numbers move by the step that least squares would take without it, within
their bounds and no further than it helps the others, and the group is predicted with them. Where the model is linear in its
numbers that is Allen's PRESS (1974) for groups; elsewhere it is one step of a fit without the group, with its true errors.
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.least_squares import Fitter, Solution, lengths
from hqpipe.identify.model import Samples

_GROUPS = 5  # as five-fold cross-validation
_PARTS = 2  # of each trial in a group: far apart, so that every group holds every motion and most of the trial's course
_SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step that are tried; assumption
_SINGULAR = 1e-9  # of the largest eigenvalue: a number that the other groups do not show stays as it is


def left_out_error(fitter: Fitter, solution: Solution) -> np.ndarray:
    """(N,) errors of every group, predicted from the others; infinite where the prediction overflows."""
    if not np.isfinite(solution.square):
        return np.full(len(solution.error), np.inf)
    jacobian, error, free = solution.jacobian, solution.error, solution.free
    spread = fitter.spread[free]
    noise = solution.square / max(len(error), 1)
    prior = np.where(np.isfinite(spread), noise / spread**2, 0.0)
    normal = jacobian.T @ jacobian + np.diag(prior)
    scale = lengths(normal)
    reach = np.where(np.isfinite(spread), spread, np.inf)  # what few samples ask for beyond that is noise
    found = np.empty(len(error))
    group = groups(fitter.model.fit)
    for number in np.unique(group):
        here = group == number
        mine = jacobian[here] / scale
        rest = normal / np.outer(scale, scale) - mine.T @ mine
        step = np.linalg.lstsq(rest, mine.T @ error[here], rcond=_SINGULAR)[0] / scale
        found[here] = _stepped(fitter, solution, np.clip(step, -reach, reach), ~here)[here]
    return found


@np.errstate(over="ignore", invalid="ignore")  # squares of an error that grows without bounds
def _stepped(fitter: Fitter, solution: Solution, step: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(N,) errors after a step of the free parameters, as much of it as serves the samples that it was made for.

    Where numbers are hardly known a whole step leads to where the slopes hold no more, and no fit would go.

    Args:
        step: (F,). rest: (N,) True for these samples.
    """
    before = float(solution.error[rest] @ solution.error[rest])
    for share in _SHARES:
        values = solution.values.copy()
        values[solution.free] += share * step
        error = fitter.error(fitter.clipped(values, solution.free))
        if float(error[rest] @ error[rest]) <= before:
            return error
    return solution.error


def groups(samples: Samples) -> np.ndarray:
    """(N,) number of the group of each sample; each has parts of every trial, so that no group holds a motion of its own."""
    found = np.empty(len(samples.trial), dtype=np.int64)
    for trial in np.unique(samples.trial):
        here = np.flatnonzero(samples.trial == trial)
        found[here] = np.arange(len(here)) * _GROUPS * _PARTS // len(here) % _GROUPS
    return found
