"""What of a set is worth a name: effects that close a share of the error and do something beside the gap.

What does less refines the law. It is significant all the same, and stands beside the causes where rivals are compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hqpipe.identify.misfit import floor_of
from hqpipe.identify.search import Known, Search
from hqpipe.identify.thresholds import CONFUSED, HALVED, LEAST_SHARE, SLIGHT


def worth_keeping(search: Search, known: Known, base: Known) -> tuple[Known, dict[str, np.ndarray]]:
    """The set without what closes too little of the error or does too little beside the gap, and what that was; what is left is
    exchanged where another set of as few is more probable.

    What counts is the error on groups of fit samples, each predicted from the others. An effect that most joints of the machine
    have need only not make it worse, and one that the joint has as they do stays.

    Args:
        known: a set that the logs ask for. base: the context alone.

    Returns:
        The set, and the numbers of the effects that were too small.
    """
    seen, small = {known.names}, {}
    while True:
        whole, known = known, _without_small(search, known, base)
        small |= _numbers_of(search, whole, sorted(whole.names - known.names))
        better = search.improved(known)
        if better.names == known.names:
            better = _likelier(search, known, base)
        if better.names in seen or not _is_better(search, better, known, small, base):
            break
        seen.add(better.names)
        known = better
    small = {name: numbers for name, numbers in small.items() if name not in known.names}
    persistence = float(np.sum((search.model.fit.held - search.model.fit.output) ** 2))
    # What predicts no better than holding the output, and leaves most of the gap, explains nothing.
    explains = search.left_out(known) < max(persistence, HALVED * search.left_out(base))
    return (known, small) if explains else (base, {})


def _is_better(search: Search, one: Known, other: Known, small: Mapping[str, np.ndarray], base: Known) -> bool:
    """Whether a set that is more probable than another by itself takes its place: where it leaves as much of the gap, what was
    too small, and the generic shapes of the other, must not refute it."""
    if search.left_out(other) - search.left_out(one) >= _least_share(search, base):
        return True
    beside = small | _numbers_of(search, other, (n for n in sorted(other.names) if not search.effects[n].named))
    against = search.log_odds(with_small(search, one, beside), with_small(search, other, beside))
    return against > np.log(CONFUSED)


def _numbers_of(search: Search, known: Known, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Effect → the values of its parameters in a set."""
    return {name: known.solution.values[search.screening.places(name)] for name in names}


def with_small(search: Search, known: Known, small: Mapping[str, np.ndarray]) -> Known:
    """A set with what was too small for a cause beside it, as far as it may stand there.

    Args:
        small: effect → its numbers.
    """
    names, values = known.names, known.solution.values.copy()
    for name in small:
        if name in search.addable(names):
            names = names | {name}
            values[search.screening.places(name)] = small[name]
    return search.known[names] if names in search.known else search.begun_from(names, values)


def _likelier(search: Search, known: Known, base: Known) -> Known:
    """The most probable of the sets of as few effects that were fitted and of which nothing is too small: the search passed it
    over for one with effects that were too small."""
    law = base.names | search.as_others.keys()
    options = [k for k in search.known.values() if law <= k.names and len(k.names) <= len(known.names)]
    options = [k for k in options if k is not known and search.may_have(k.names) and search.likelier(k, known)]
    for option in sorted(options, key=lambda k: (-search.preference(k, known), sorted(k.names))):
        if _without_small(search, option, base).names == option.names:
            return search.known[option.names]
    return known


def _without_small(search: Search, known: Known, base: Known) -> Known:
    """The set without what is too small, what closes least first; arguments as of `worth_keeping`."""
    least = _least_share(search, base)
    while rest := sorted(known.names - base.names):
        known, smaller = search.taken_apart(known, rest)
        square = search.left_out(known)
        closes = {name: search.left_out(smaller[name]) - square for name in rest}
        asked = [name for name in rest if name not in search.shared]
        left = search.in_reach(known, square)
        needed = dict.fromkeys(rest, 0.0) | {n: search.needed(left, search.is_usual(known, n)) for n in asked}
        small = [
            name
            for name in rest
            if name not in search.as_others
            and (closes[name] < needed[name] or not _is_large(search, known, name, least, closes[name]))
        ]
        if not small:
            better = search.settled(known)
            if better is known:
                break
            known = better
            continue
        known = search.without(known, min(small, key=lambda name: closes[name]))
    return known


def _least_share(search: Search, base: Known) -> float:
    """Squared error that a cause has to close."""
    return LEAST_SHARE * max(search.left_out(base) - floor_of(search.model), 0.0)


def _is_large(search: Search, known: Known, name: str, least: float, closes: float) -> bool:
    """Whether an effect has the size of a cause; what both of two records have, or every sound machine has, is part of the law
    and needs no size.

    Args:
        least: square of what it must do to the prediction. closes: what it closes of the squared error beside the others, which
            speaks for one that is smaller than a data sheet would mention.
    """
    if search.effects[name].in_both or search.is_ordinary(known, name):
        return True
    if not is_admitted(search, known, name) or search.screening.does(known, name) < least:
        return False
    usual = search.fitter.spread[search.screening.places(name)[0]] if search.effects[name].named else np.inf
    return closes >= least or not np.isfinite(usual) or search.size(known, name) >= SLIGHT * usual


def is_admitted(search: Search, known: Known, name: str) -> bool:
    """Whether an effect is larger than every sound machine may have it, and not at its bound."""
    return search.size(known, name) >= search.sound_size(known, name) and search.within_bounds(known, name)


def causes_of(search: Search, known: Known, base: Known) -> list[str]:
    """The named effects of a set beside the context, without what every sound machine has."""
    rest = known.names - base.names
    return sorted(name for name in rest if search.effects[name].named and not search.is_ordinary(known, name))
