"""What most joints of a machine have, in a joint where its number is unlike theirs.

Joints of one make scatter around what they share: valves of one type, one controller. A lag that is twice that of every other
joint may be just that, or the lag of the others with a delay beside it, which nothing but the other joints could tell. What is
shared are times, rates and ratios; torques and angles also depend on the lever and the piston of a joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import median_abs_deviation, t

from hqpipe.identify.found import JointFound
from hqpipe.identify.joint_answer import answer, with_law_of_machine
from hqpipe.identify.search import Known, Names, Search
from hqpipe.identify.thresholds import CONFUSED, OVERSTATED

# What parts of one make share; N·m and rad hang on lever and piston, which differ between roll, pitch and knee.
_SHARED_UNITS = frozenset({"1", "s", "1/s", "Hz"})


@dataclass(frozen=True)
class OwnNumber:
    """A cause that most joints have, with a number that is unlike theirs.

    Attributes:
        effect: its name. rivals: effects that could stand in its place. others: range of its first number in the other joints.
    """

    effect: str
    rivals: tuple[str, ...]
    others: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Beside:
    """A rival beside an effect whose number is as in the other joints.

    Attributes:
        effect, rival: their names. odds: of the effect with a number of the joint's own against both.
        search, known: with both. earlier, earlier_known: before.
    """

    effect: str
    rival: str
    odds: float
    search: Search
    known: Known
    earlier: Search
    earlier_known: Known


def own_numbers(answers: Sequence[JointFound], shared: Names) -> dict[int, tuple[OwnNumber, ...]]:
    """Joint → its causes that most joints have with another number, as far as joints may share it, where something else may
    stand in their place.

    Args:
        answers: of the joints of a machine. shared: causes of most of them.
    """
    found = {}
    for j, joint in enumerate(answers):
        own, names = [], {cause.effect for cause in joint.causes}
        for cause in joint.causes:
            rivals = tuple(name for name in cause.confused_with if name not in names)
            others = [n for k, other in enumerate(answers) if k != j for n in _numbers(other, cause.effect)]
            if not rivals or cause.effect not in shared or len(others) < 2 or not _numbers(joint, cause.effect):
                continue
            low, high = range_of(others)
            if not low <= cause.numbers[0].value <= high:
                own.append(OwnNumber(cause.effect, rivals, (low, high)))
        if own:
            found[j] = tuple(own)
    return found


def range_of(numbers: Sequence[float]) -> tuple[float, float]:
    """Where one more number lies with 1 − `CONFUSED`, if it scatters as these, of which less than half do not belong to them:
    Student's interval for a new observation, with the median and the scaled median deviation (Hampel 1974)."""
    count = len(numbers)
    reach = t.ppf(1.0 - CONFUSED / 2.0, count - 1) * np.sqrt(1.0 + 1.0 / count)
    middle, half = float(np.median(numbers)), float(reach * median_abs_deviation(numbers, scale="normal"))
    return middle - half, middle + half


def as_others_have(search: Search, known: Known, kept: Names, own: OwnNumber) -> Beside | None:
    """A number as the other joints have it, and the rival beside that for which the errors say most; None where the joint asks
    for no rival then, or its errors say that the number is its own.

    Errors seem to say more for what few joints have than they do, so the number may be the joint's own all the same. A set that
    lacks one of the two, or that the errors refute, has no answer that could have both.

    Args:
        search: a finished one. known: the set that it reached. kept: effects of its answer.
    """
    before, options = search.known[kept], []
    start, judged = known if own.effect in known.names else before, with_law_of_machine(search, before, known)
    fitted = Search(search.model, search.odds, {**search.as_others, own.effect: own.others})
    for rival in own.rivals:
        again = _begun_again(search, fitted, own, rival)
        reached = again.improved(again.grown_by(_begun(again, start, rival), rival))
        both = {own.effect, rival}
        if not both <= reached.names or again.telling(reached, judged) < np.log(CONFUSED):
            continue
        found = answer(again, reached)
        told = again.known[frozenset(found.kept.effects)]
        says = again.telling(with_law_of_machine(again, told, reached), judged)
        named = both <= {cause.effect for cause in found.causes}
        if named and says >= np.log(CONFUSED) and len(told.names) <= len(kept) + 1:
            odds = float(np.exp(-max(says, 0.0) / OVERSTATED))
            options.append((says, Beside(own.effect, rival, odds, again, reached, search, known)))
    return max(options, key=lambda option: option[0], default=(0.0, None))[1]


def with_own_number(found: JointFound, beside: Beside) -> JointFound:
    """An answer with the effect among those that its rival is confused with, unless it is too improbable for that."""
    causes = [
        replace(cause, confused_with=(*cause.confused_with, beside.effect), odds=(*cause.odds, beside.odds))
        if cause.effect == beside.rival and beside.odds >= CONFUSED
        else cause
        for cause in found.causes
    ]
    return replace(found, causes=tuple(causes))


def _begun_again(search: Search, fitted: Search, own: OwnNumber, rival: str) -> Search:
    """The search from its beginning with the number as the other joints have it, and with a rival that may join.

    Args:
        fitted: one with that number, whose fits serve the search for every rival.
    """
    found = copy(fitted)
    found.barred, found.refused, found.given_up = (
        names - {own.effect, rival} for names in (search.barred, search.refused, search.given_up)
    )
    found.gains, found.shared, found.rare = {}, search.shared, search.rare | {rival}
    return found


def _begun(search: Search, start: Known, rival: str) -> Known:
    """The set of an earlier search without what excludes a rival that is to join it."""
    values, effects = start.solution.values.copy(), search.effects
    shut = {name for name in start.names if name in effects[rival].excludes or rival in effects[name].excludes}
    for name in shut:
        values[search.screening.places(name)] = search.fitter.neutral[search.screening.places(name)]
    return search.begun_from(start.names - shut, values)


def _numbers(joint: JointFound, effect: str) -> list[float]:
    """The first number of an effect, if the joint has it as a cause and joints may share it."""
    own = [cause.numbers[0] for cause in joint.causes if cause.effect == effect and cause.numbers]
    return [number.value for number in own if number.unit in _SHARED_UNITS]
