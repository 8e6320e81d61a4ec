"""Causes that are small beside what no effect explains.

Where much of a gap is left, some effect describes a part of it by chance, however probable it is: the probability compares it
with the library alone. Such a cause is believed only if it closes a share of the gap that counts beside what is left, in the
joint or in those joints of the machine that show it best. What generic shapes describe is left, too: they have no name, and
beside them a small effect would look large. What is faster than the effects of the joint act is not, as none could have
described it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from hqpipe.identify.found import JointFound
from hqpipe.identify.thresholds import HALVED


def without_minor_causes(
    answers: Sequence[JointFound], answered_without: Callable[[Mapping[int, str]], Mapping[int, JointFound]]
) -> list[JointFound]:
    """The answers of a machine's joints without such causes; in each joint the least one goes first, as others that it has may
    take its part.

    What the logs ask for only where a more probable effect is barred stands for that one, and goes with it.

    Args:
        answers: of each joint. answered_without: number of a joint → effect that is barred from now on, to its answer.
    """
    answers = list(answers)
    asked = [_asked_for(answer) for answer in answers]
    while weak := [*_minor(answers), *_stand_ins(answers, asked)]:
        least = {j: effect for _, effect, j in sorted(weak, reverse=True)}
        for j, answer in answered_without(least).items():
            answers[j] = answer
    return answers


def _asked_for(answer: JointFound) -> frozenset[str]:
    """What the logs of a joint ask for: what fits best, what is named for it, and what they cannot tell from that."""
    return frozenset(answer.full.effects).union(*((cause.effect, *cause.confused_with) for cause in answer.causes))


def _stand_ins(answers: Sequence[JointFound], asked: Sequence[frozenset[str]]) -> list[tuple[float, str, int]]:
    """Causes as of `_minor` that were not asked for before others were barred; asked: effects of each joint."""
    return [(0.0, name, j) for j, joint in enumerate(answers) for name in joint.beside_unknown if name not in asked[j]]


def _minor(answers: Sequence[JointFound]) -> list[tuple[float, str, int]]:
    """(what it closes over what it has to close, effect, joint) of each such cause.

    Joints that show an effect clearly count towards it in those that show it less, each relative to its base. Two causes that
    most joints have may each take most of the other's part of the gap.
    """
    found = []
    for effect in sorted({name for joint in answers for name in joint.beside_unknown}):
        having = [
            (j, joint.beside_unknown[effect]) for j, joint in enumerate(answers) if effect in joint.beside_unknown
        ]
        told = {j: (beside.closes, HALVED * beside.unknown) for j, beside in having}
        shares = {j: closed / max(needed, 1e-12) for j, (closed, needed) in told.items()}
        closes = least = 0.0
        for j in sorted(shares, key=lambda j: -shares[j]):
            closes, least = closes + told[j][0], least + told[j][1]
            if closes < least:
                found.append((shares[j], effect, j))
    return found
