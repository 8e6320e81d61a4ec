"""Rounds of additions, exchanges and removals, until no change of one effect, nor the addition of two, makes the logs more
probable."""

from __future__ import annotations

from hqpipe.identify.misfit import misfit_noise
from hqpipe.identify.screening import Known
from hqpipe.identify.search import MOST_EFFECTS, Search

_ROUNDS = 3  # assumption: what still changes then is a draw
_FIRSTS, _SECONDS = (
    2,
    2,
)  # of two effects that join at once: those that leave least alone, and what promises most beside each
_EXPLAINED = 1.5
"""Of the squared error that noise leaves, up to which nothing is looked for that no single effect shows; assumption."""


def searched(search: Search) -> Known:
    """The set that is reached from the base, or from what the model offers to begin with."""
    best = _begun_with(search)
    for _ in range(_ROUNDS):
        before = best.names
        best = search.settled(search.improved(search.grown(best)))
        if best.names == before:
            best = search.settled(search.improved(search.grown(_with_two(search, best))))
            if best.names == before:
                break
    return best


def _begun_with(search: Search) -> Known:
    """The set that a model offers to begin with, without what is not needed of it; else the base."""
    begin = getattr(search.model, "begin", None)
    if begin is None:
        return search.base
    first = search.begun_from(*begin)
    return search.improved(first) if search.gain(first, search.base) > 0.0 else search.base


def _with_two(search: Search, best: Known) -> Known:
    """The set with two effects more of which neither is asked for alone, if the logs ask for both.

    While much is wrong, errors stay alike for long and say little of one effect; they say more of it beside another one.
    """
    floor = len(best.solution.error) * misfit_noise(search.model)[0] ** 2
    if best.solution.square <= _EXPLAINED * floor or len(best.names) + 2 > MOST_EFFECTS:
        return best
    joined = [best.names | {name} for name in search.addable(best.names)]
    one_more = sorted(
        (search.known[names] for names in joined if names in search.known), key=lambda k: k.solution.square
    )
    two_more = [
        search.grown_by(one, name)
        for one in one_more[:_FIRSTS]
        for _, name in search.screening.screened(one, search.addable(one.names))[:_SECONDS]
    ]
    larger = max(two_more, key=lambda k: search.gain(k, best), default=best)
    return larger if larger is not best and search.gain(larger, best) > 0.0 else best
