"""Rounds of additions, exchanges and removals, until no change of one effect makes the logs more probable, nor two in the place
of one; in a joint that has no others to learn from, nor the addition of two; in others, the way beyond where a gap is left."""

from __future__ import annotations

from itertools import combinations

from hqpipe.identify.misfit import floor_of
from hqpipe.identify.screening import Known
from hqpipe.identify.search import MOST_EFFECTS, Search
from hqpipe.identify.thresholds import HALVED, LEAST_GAIN, OVERSTATED

_ROUNDS = 3  # assumption: what still changes then is a draw
_FIRSTS = 2  # of the sets with one effect more, those that err least, to which a second one is added; assumption
_SECONDS = 2  # of the effects that promise most beside each of these; assumption
_EXPLAINED = 1.5
"""Of the squared error that noise leaves, up to which nothing is looked for that no single effect shows; assumption."""


def searched(search: Search, alone: bool) -> Known:
    """The set that is reached from the base, or from what the model offers to begin with.

    Args:
        alone: whether the machine has no other joint. Joints that have others try what these have reached, which costs
            less than to add two effects at once and mostly does the same.
    """
    best = _begun_with(search)
    for _ in range(_ROUNDS):
        before = best.names
        best = _improved(search, best)
        if (two := _two_for_one(search, best)) is not None:
            best = _improved(search, two)
        if best.names == before and alone:
            best = _improved(search, _with_two(search, best))
        if best.names == before:
            break
    return best


def _improved(search: Search, best: Known) -> Known:
    return search.settled(search.improved(search.grown(best)))


def _begun_with(search: Search) -> Known:
    """The set that a model offers to begin with, without what is not needed of it; else the base."""
    begin = getattr(search.model, "begin", None)
    if begin is None:
        return search.base
    first = search.begun_from(*begin)
    return search.improved(first) if search.gain(first, search.base) > 0.0 else search.base


def _two_for_one(search: Search, best: Known) -> Known | None:
    """A more probable set with two effects in the place of one, which had stood for a part of both; None if there is none."""
    for name in sorted(best.names):
        smaller = search.without(best, name)
        for option in search.replaced(smaller, name):
            lacking = option.solution.square - best.solution.square
            if lacking > HALVED * option.solution.square or len(option.names) >= MOST_EFFECTS:
                continue
            ranked = search.screening.screened(option, search.addable(option.names))[:1]
            if not ranked or ranked[0][0] < lacking:
                continue  # nothing promises to make it err less
            two = search.grown_by(option, ranked[0][1])
            if search.preference(two, best) > 0.0:
                return two
    return None


def with_one_for_two(search: Search, best: Known) -> Known:
    """The set with one effect in the place of two that few joints of the machine have, as long as the errors, which say too
    much for these, do not refute it; among others with each of those that half of all joints have, as friction."""
    for pair in combinations(sorted(best.names & search.rare), 2):
        smaller = search.without(search.without(best, pair[0]), pair[1])
        common = [name for name in search.addable(smaller.names) if search.effects[name].common and name not in pair]
        for option in (*search.rivals(smaller, *pair), *(search.grown_by(smaller, name) for name in common)):
            if search.preference(option, best, OVERSTATED) > 0.0:
                return with_one_for_two(search, option)
    return best


def _with_two(search: Search, best: Known) -> Known:
    """The set with two effects more of which neither is asked for alone, if the logs ask for both.

    While much is wrong, errors stay alike for long and say little of one effect; they say more of it beside another one.
    """
    if best.solution.square <= _EXPLAINED * floor_of(search.model) or len(best.names) + 2 > MOST_EFFECTS:
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


def forward_then_backward(search: Search, best: Known) -> Known:
    """A more probable set beyond one that leaves a part of the gap, among those with several effects more that no single step
    leads to, if it leaves less than half as much.

    While much is wrong, errors stay alike for long and say little of one effect. So what leaves least joins without being asked
    for, until no gap is left or nothing closes a part of it; then everything that is not needed leaves again. What explains
    little more than before may do so by chance: several effects together can describe a part of anything.
    """
    larger = best
    while len(larger.names) < MOST_EFFECTS and _gap_left(search, larger) > LEAST_GAIN * _gap_left(search, search.base):
        least = min(search.one_more(larger).values(), key=lambda known: known.solution.square, default=larger)
        if least.solution.square > larger.solution.square / (1.0 + LEAST_GAIN):
            break
        larger = least
    if larger is best or _gap_left(search, larger) > HALVED * _gap_left(search, best):
        return best  # with fewer effects it leaves more
    found = _improved(search, larger)
    decides = _gap_left(search, found) < HALVED * _gap_left(search, best)
    return found if decides and search.likelier(found, best) else best


def _gap_left(search: Search, known: Known) -> float:
    """What a set leaves of the squared error above the noise."""
    return max(known.solution.square - floor_of(search.model), 0.0)
