"""What the logs of one joint say of one effect more, one less, or one in the place of another, and the set after that."""

from __future__ import annotations

from hqpipe.identify.joint_moves import Step, Worths
from hqpipe.identify.search import Known, Search


def steps(search: Search, known: Known) -> Worths:
    """What the logs say of each step from a set to one that was fitted."""
    found: dict[Step, float] = {}
    for name in search.addable(known.names):
        if known.names | {name} in search.known:
            found[Step(None, name)] = _worth(search, search.grown_by(known, name), known)
    for name in sorted(known.names):
        smaller = search.without(known, name)
        found[Step(name, None)] = -_worth(search, known, smaller)
        for other in search.addable(smaller.names):
            if other != name and smaller.names | {other} in search.known:
                option = search.grown_by(smaller, other)
                odds = search.odds[other] - search.odds[name]
                found[Step(name, other)] = search.preference(option, known) - odds
    return found


def after(search: Search, known: Known, step: Step) -> Known:
    """The set after a step."""
    smaller = known if step.leaves is None else search.without(known, step.leaves)
    return smaller if step.joins is None else search.grown_by(smaller, step.joins)


def _worth(search: Search, large: Known, small: Known) -> float:
    """ln of how much more probable the logs are with a set than with a part of it, the prior of the effects left aside."""
    return search.gain(large, small) - sum(search.odds[name] for name in large.names - small.names)
