"""How large an effect would have to be for these logs to name it: what "no cause" is worth."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.misfit import floor_of
from hqpipe.identify.search import Known, Search
from hqpipe.identify.thresholds import HALVED, LEAST_SHARE, OVERSTATED

UNUSUAL = 3.0  # spreads of the prior beyond which no machine is; as three standard deviations


def least_visible(search: Search, known: Known, base: Known, rare: Collection[str] = ()) -> dict[str, float]:
    """Named effect that a set lacks → how far its first number has to be from neutral to be named beside the set.

    The rules of the criterion ask for a share of the squared error, and for a share of the gap that the effect moves. Both grow
    with the square of its size, the first as far as the free numbers cannot do the same. Effects that the free numbers can
    imitate are left out.

    Args:
        known: the set that was kept. base: without causes. rare: effects that most joints of the machine do not have.
    """
    left = search.in_reach(known, search.left_out(known))
    unexplained = max(left - floor_of(search.model), 0.0)
    gap = max(search.left_out(base) - floor_of(search.model), 0.0)
    time = correlation_time(known.solution.error, search.model.fit)
    found = {}
    for name in search.addable(known.names):
        effect, reached = search.effects[name], search.screening.reach(known, name)
        if not effect.named or reached is None:
            continue
        size, done, square = reached
        alike = (OVERSTATED if name in rare else 1.0) * time
        sizes = []
        for is_usual in (False, True):
            needed = least_square(search, name, left, unexplained, known.covariance.noise, alike, is_usual)
            sizes.append(size * float(np.sqrt(max(needed / square, LEAST_SHARE * gap / done))))
        found[name] = max(least_of(sizes[0], sizes[1], search.usual_size(name)), search.sound_size(known, name))
    return found


def least_of(any_size: float, of_usual: float, usual: float) -> float:
    """The least size that is named, of the least by what is asked of effects of any size and of those of usual size.

    Args:
        usual: from where on effects are of usual size.
    """
    return min(any_size, max(of_usual, usual))


def least_square(
    search: Search,
    name: str,
    left: float,
    unexplained: float,
    variance: float,
    time: float = 1.0,
    is_usual: bool = False,
) -> float:
    """Square of what an effect has to change in the prediction, beyond what the free numbers can do, to be named.

    Args:
        left: squared error beside the effect, of `Search.in_reach`. unexplained: as much of it as is above the noise of the
            sensors. variance: of the errors. time: samples that say as much as one that is independent.
        is_usual: whether it is of usual size.
    """
    independent = max(len(search.model.fit.trial) / time, 1.0)
    charge = 0.5 * len(search.effects[name].parameters) * float(np.log(independent)) - search.odds[name]
    rules = max(search.needed(left, is_usual), HALVED * unexplained)
    return max(rules, 2.0 * max(charge, 0.0) * variance * time)
