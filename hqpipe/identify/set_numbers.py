"""How sure the numbers of a set are: what the intervals say, within what was known beforehand."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.beside import rank_beside
from hqpipe.identify.found import SetNumbers
from hqpipe.identify.intervals import normal_covariance
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import JointModel
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Known, Search

_OF_ITSELF = 0.3
"""Deviation of a coefficient about which nothing is known beforehand, as a share of it: as far as data sheets of valve and oil
tell it; assumption. In the paper's model the stiffness of the reference plant is that far from its design. The logs of a joint
that follows the law fix k1 to k3 ten times better, so that this counts where the law does not hold."""
_OF_BOUND = (
    0.01  # the same of the most that a coefficient may be, for those near 0: impacts take a few per cent; assumption
)


def set_numbers(search: Search, known: Known, fitted_only: bool = False) -> SetNumbers | None:
    """The numbers of a set with the covariance behind their intervals; None where the prediction overflows.

    Call `rank_beside` before. What the logs do not determine has an interval that is wide, or that a few trials make so: no
    deviation is larger than `prior_deviations`; correlations stay.

    Args:
        fitted_only: whether only what the search has tried beside the set says how far the law may be wrong.
    """
    solution, fitter = known.solution, search.fitter
    if not np.isfinite(solution.square):
        return None
    covariance, free = normal_covariance(search, known, fitted_only), solution.free
    deviation = np.sqrt(np.diag(covariance))
    most = prior_deviations(fitter, solution.values, free)
    share = np.minimum(1.0, np.divide(most, deviation, out=np.ones(len(free)), where=deviation > 0.0))
    share[np.isin(free, list(_idle(fitter.model, solution.values)))] = 0.0
    covariance = covariance * np.outer(share, share)
    return SetNumbers(solution.values, free, covariance, fitter.low[free], fitter.high[free])


def base_numbers(model: JointModel) -> SetNumbers | None:
    """The numbers of a joint without any effect; None where the prediction overflows."""
    search = Search(model, prior_odds(model, {}, 0))
    if not np.isfinite(search.base.solution.square):
        return None
    rank_beside(search, search.base)
    return set_numbers(search, search.base)


def prior_deviations(fitter: Fitter, values: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(F,) how far numbers may be from their estimates by what is known without the logs.

    That is the size that a data sheet would give, the width of the prior, or what was found if that is more: a number that may
    as well be none. Of a coefficient without a prior that is never negative it is `_OF_ITSELF` or `_OF_BOUND`; one that may
    have either sign, as an offset, has no such limit.
    """
    spread, away = fitter.spread[free], np.abs(values - fitter.neutral)[free]
    span = (fitter.high - fitter.low)[free]
    size = np.where(fitter.low[free] < 0.0, np.inf, _OF_ITSELF * np.abs(values[free]))
    size = np.maximum(size, np.where(np.isfinite(span), _OF_BOUND * span, 0.0))
    return np.where(np.isfinite(spread), np.maximum(spread, away), size)


def _idle(model: JointModel, values: np.ndarray) -> tuple[int, ...]:
    """Places of numbers that change nothing at these values; see `hqpipe.identify.model.JointModel`."""
    idle = getattr(model, "idle", None)
    return tuple(idle(values)) if idle is not None else ()
