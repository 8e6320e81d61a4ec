"""Numbers that differ from trial to trial: a sign that an effect is missing which depends on what differs between the trials.

A constant of the machine is the same at every gain and load. For each parameter the best deviation of each trial is taken from
the slope of its errors, all other parameters as fitted, and the scatter of these is held against what their errors explain.
With enough data an inexact law makes many a number differ a little. So, as of a cause, it must also matter: with numbers of
their own the trials have to err so much less that an effect which does it would be a cause.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.misfit import floor_of
from hqpipe.identify.model import all_parameters
from hqpipe.identify.search import Known, Search
from hqpipe.identify.thresholds import LEAST_SHARE

_CHANCE = 1e-4  # probability of such a scatter by chance; assumption: some ten numbers a joint are looked at
NOTABLE = 0.2  # of a number itself, between trials or records; assumption: a smaller difference changes no answer
_LEAST_TRIALS = 3


def drifts(search: Search, best: Known, base: Known) -> tuple[str, ...]:
    """A sentence for each number of the joint that is not the same in all fit trials.

    Args:
        best: the set that describes the joint. base: without its causes.
    """
    model, solution = search.model, best.solution
    samples = model.fit
    here = [k for k in range(len(samples.files)) if np.any(samples.trial == k)]
    if len(here) < _LEAST_TRIALS:
        return ()
    time = correlation_time(solution.error, samples)
    gap = base.solution.square - floor_of(model)
    least = max(search.needed(search.in_reach(best, solution.square), False), LEAST_SHARE * gap)
    parameters = all_parameters(model)
    found = []
    for place, index in enumerate(solution.free):
        slope = solution.jacobian[:, place]
        moves, weights = [], []
        for k in here:
            mine = samples.trial == k
            information = float(slope[mine] @ slope[mine])
            if information > 0.0:
                moves.append(-float(slope[mine] @ solution.error[mine]) / information)
                weights.append(information / (best.covariance.noise * time))
        value = abs(float(solution.values[index]))
        moved, weight = np.array(moves), np.array(weights)
        if len(moved) < _LEAST_TRIALS or value == 0.0:
            continue
        scatter = float(weight @ (moved - weight @ moved / weight.sum()) ** 2)
        closes = scatter * best.covariance.noise * time
        spread = float(np.sqrt(max(np.average((moved - np.average(moved, weights=weight)) ** 2, weights=weight), 0.0)))
        if chi2.sf(scatter, len(moved) - 1) < _CHANCE and spread > NOTABLE * value and closes >= least:
            ends = solution.values[index] + np.array([moved.min(), moved.max()])
            low, high = np.clip(ends, search.fitter.low[index], search.fitter.high[index])
            parameter = parameters[index]
            unit = "" if parameter.unit == "1" else f" {parameter.unit}"
            found.append(
                f"{model.joint}: {parameter.name} differs from trial to trial, from {low:.3g} to {high:.3g}{unit}: "
                "an effect that depends on what differs between them is missing"
            )
    return tuple(found)
