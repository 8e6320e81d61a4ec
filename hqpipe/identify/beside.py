"""What the logs may ask for beside a set: how likely each other effect is, and the sets with one effect more."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.search import REFITTED, Known, Search

_UNLIKELY = -3.0  # ln of odds below which an effect is left aside: 5 %


def rank_beside(search: Search, best: Known) -> None:
    """Set the gains of all effects beside a set: of a fit where there is one, else of what the slope promises.

    A promise is charged as by Schwarz (1978): half the logarithm of the independent samples for each number.
    """
    time = correlation_time(best.solution.error, search.model.fit)
    independent = len(best.solution.error) / time
    promises = {name: gain for gain, name in search.screening.screened(best, search.addable(best.names))}
    for name, effect in search.effects.items():
        if name in best.names:
            search.gains[name] = search.gain(best, search.without(best, name))
            continue
        larger = search.grown_by(best, name) if best.names | {name} in search.known else None
        worth = 0.5 * promises.get(name, 0.0) / (best.covariance.noise * time)
        charge = 0.5 * len(effect.parameters) * float(np.log(max(independent, 1.0)))
        charge += search.price_of_settled(best, frozenset({name})) - search.odds[name]
        search.gains[name] = search.gain(larger, best) if larger else worth - charge


def sets_beside(search: Search, known: Known, fitted_only: bool = False) -> list[Known]:
    """Sets with one effect more that the logs may ask for, those that are barred or refused among them; after `rank_beside`.

    Args:
        fitted_only: whether to leave out sets that have not been fitted yet.
    """
    able = {*search.addable(known.names), *search.barred, *search.refused, *search.given_up} - known.names
    able = {name for name in able if not search.effects[name].excludes & known.names}
    if fitted_only:
        able = {name for name in able if known.names | {name} in search.known}
    likely = sorted(
        (name for name in able if search.gains[name] > _UNLIKELY), key=lambda name: (-search.gains[name], name)
    )
    return [search.grown_by(known, name) for name in likely[:REFITTED]]
