"""Causes that are small beside what nobody explains.

Where much of a gap is left, some effect will describe a part of it by chance, however certain it is that the logs are described
better with it: the probability compares it with the library alone. Such a cause is believed only if it closes a share of the
gap that counts beside what is left.
"""

from __future__ import annotations

from collections.abc import Sequence

from hqpipe.identify.found import JointFound
from hqpipe.identify.joint_answer import answer
from hqpipe.identify.search import Known, Search

LEAST_OF_UNKNOWN = 0.5
"""Of what is left unexplained above the noise, in squares, that a cause must close over the joints that have it: then a third of
what it and the unknown make together is known. Assumption: a law that is missing is alike to one of a dozen candidates by a
third of its square at most. The cost: a real effect smaller than that is not named, and counts as unknown."""


def without_outweighed(searched: Sequence[tuple[Search, Known]], answers: Sequence[JointFound]) -> tuple[JointFound, ...]:
    """The answers of a machine's joints without such causes; the least one goes first, as others may take its part.

    Args:
        searched, answers: of each joint.
    """
    answers = list(answers)
    while ratios := _ratios(answers):
        effect = min(ratios, key=lambda name: (ratios[name], name))
        if ratios[effect] >= LEAST_OF_UNKNOWN:
            break
        for j, (search, best) in enumerate(searched):
            if effect in answers[j].closes:
                search.barred.add(effect)
                answers[j] = answer(search, search.improved(search.without(best, effect)))
    return tuple(answers)


def _ratios(answers: Sequence[JointFound]) -> dict[str, float]:
    """Cause → what it closes over what is left, each joint's squared errors relative to its base."""
    closed: dict[str, float] = {}
    left: dict[str, float] = {}
    for joint in answers:
        for effect, share in joint.closes.items():
            closed[effect] = closed.get(effect, 0.0) + share
            left[effect] = left.get(effect, 0.0) + joint.unexplained
    return {effect: share / left[effect] if left[effect] > 0.0 else float("inf") for effect, share in closed.items()}
