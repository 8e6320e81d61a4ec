"""Effects of a set whose numbers cannot be told from none.

What an effect does need not vanish with its numbers: an integrator that hardly integrates still holds what it began with, and
stands for an offset. The odds of a set do not see that; the numbers do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from hqpipe.identify.least_squares import lengths
from hqpipe.identify.sampling import covariance
from hqpipe.identify.search import Known, Search
from hqpipe.identify.uncertainty import LEVEL


def certainty(search: Search, known: Known, name: str) -> float:
    """How far the numbers that say how large an effect is are from neutral, together, over how far they can be told from it
    (Wald 1943); above 1 where the logs say that it is there. Infinite for generic shapes and what is a part of the law.

    Its shape is held: an effect without a size has none, and where the logs do not show the shape, slopes would let one number
    undo what the other does.
    """
    effect = search.effects[name]
    if not effect.named or effect.in_both or name in search.as_others or not np.isfinite(known.solution.square):
        return np.inf
    shape = np.array([parameter.shape for parameter in effect.parameters])
    places = search.screening.places(name)
    held = ~np.isin(known.solution.free, places[shape])
    free, places = known.solution.free[held], places[~shape]
    own = np.searchsorted(free, places)
    variance = _posterior(search, known, held)[np.ix_(own, own)]
    scale = lengths(variance)
    away = (known.solution.values - search.fitter.neutral)[places] / scale
    square = away @ np.linalg.pinv(variance / np.outer(scale, scale), hermitian=True) @ away
    return float(np.sqrt(max(square, 0.0) / chi2.ppf(LEVEL, len(places))))


def _posterior(search: Search, known: Known, kept: np.ndarray) -> np.ndarray:
    """Posterior covariance of some of the free parameters, the others held; kept: (F,) bool."""
    if kept.all():
        return known.covariance.posterior
    solution = known.solution
    part = replace(solution, free=solution.free[kept], jacobian=solution.jacobian[:, kept])
    return covariance(search.fitter, part).posterior


def without_uncertain(search: Search, best: Known) -> Known:
    """The set without such effects, the least certain first, completed and improved without them.

    They are refused, but for those that can be told from none in the place of another effect of the set that is reached: of
    two that are alike each makes the other uncertain.
    """
    left = set()
    while best.names:
        least = min(sorted(best.names), key=lambda name: certainty(search, best, name))
        if certainty(search, best, least) > 1.0:
            break
        left.add(least)
        search.refused.add(least)
        best = search.improved(search.grown(search.without(best, least)))
    search.refused -= {name for name in left if replaces(search, best, name)}
    return best


def replaces(search: Search, best: Known, name: str) -> bool:
    """Whether an effect can be told from none in the place of one of a set."""
    rest = [search.without(best, other) for other in sorted(best.names)]
    free = [known for known in rest if not search.effects[name].excludes & known.names]
    return any(certainty(search, search.grown_by(known, name), name) > 1.0 for known in free)
