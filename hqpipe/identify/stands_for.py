"""Effects for a part of which a cause may stand.

What closes too little for a name beside the causes may be there all the same. Where a cause does less than half beside it of
what it does without it, both do the same, and how much of that is the other's is open: a lag of 7 ms may be one of 4 ms and a
delay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from hqpipe.identify.beside import rank_beside, sets_beside
from hqpipe.identify.found import JointFound
from hqpipe.identify.search import Known, Names, Search
from hqpipe.identify.thresholds import HALVED

StandsFor = Mapping[str, tuple[str, ...]]
"""Cause → effects with a name for a part of which it may stand, the most probable first."""


def stands_for(search: Search, known: Known, causes: Names) -> StandsFor:
    """What the causes of a finished search may stand for.

    Args:
        known: the set that gives their numbers.
    """
    rank_beside(search, known)
    does = {name: search.screening.does(known, name) for name in sorted(causes)}
    found: dict[str, tuple[str, ...]] = {}
    for larger in sets_beside(search, known):
        (added,) = larger.names - known.names
        if not search.effects[added].named or search.gain(larger, known) <= 0.0:
            continue
        for name, alone in does.items():
            if search.screening.does(larger, name) <= HALVED * alone:
                found[name] = (*found.get(name, ()), added)
    return found


def with_what_they_stand_for(answers: Sequence[JointFound], told: Sequence[StandsFor]) -> tuple[JointFound, ...]:
    """The answers of a machine's joints, with these effects among those that each cause is confused with; no joint takes a name
    from them, nor does a simulator exchange them."""
    found = []
    for joint, own in zip(answers, told, strict=True):
        causes = tuple(
            replace(cause, confused_with=tuple(dict.fromkeys((*cause.confused_with, *own.get(cause.effect, ())))))
            for cause in joint.causes
        )
        found.append(replace(joint, causes=causes))
    return tuple(found)
