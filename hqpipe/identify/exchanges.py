"""Which effects may stand in the place of causes, in all joints of a machine that have the cause.

A rival of a cause is one in every joint that has the cause, or in none, as a machine has a delay of the command or one of the
valve in all of its joints. It is one where half of these joints list it, as in the report.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.found import Exchange, JointCause, JointFound, SetNumbers
from hqpipe.identify.joint_moves import Step
from hqpipe.identify.prior import MOST_JOINTS
from hqpipe.identify.thresholds import CONFUSED

LEAST_ODDS = CONFUSED / (1.0 - CONFUSED)
"""Of a rival: it is listed because the logs do not rule it out, and its odds fall below this only where errors are compared as
if the law were exact. Nor are those of the cause lower, which was named."""


@dataclass(frozen=True)
class Rival:
    """An exchange that a machine may have.

    Attributes:
        step: the cause that leaves and the effect that joins. odds: of the second against the first. joints: numbers of those
            that have the cause.
    """

    step: Step
    odds: float
    joints: tuple[int, ...]


def rivals_of(answers: Sequence[JointFound]) -> list[Rival]:
    """The exchanges of a machine; the odds are the median of the joints, as a cause is as probable as in the middle one.

    Args:
        answers: of each joint.
    """
    having: dict[str, list[tuple[int, JointCause]]] = {}
    for j, joint in enumerate(answers):
        for cause in joint.causes:
            having.setdefault(cause.effect, []).append((j, cause))
    found = []
    for effect, causes in sorted(having.items()):
        listed: dict[str, list[float]] = {}
        for _, cause in causes:
            known = dict(zip(cause.confused_with, cause.odds, strict=False))
            for rival in dict.fromkeys(cause.confused_with):
                listed.setdefault(rival, []).append(known.get(rival, 1.0))
        for rival, odds in sorted(listed.items()):
            if len(odds) >= MOST_JOINTS * len(causes):
                median = float(np.clip(np.median(odds), LEAST_ODDS, 1.0 / LEAST_ODDS))
                found.append(Rival(Step(effect, rival), median, tuple(j for j, _ in causes)))
    return found


def with_numbers(
    joint: JointFound, own: SetNumbers | None, exchanged: Mapping[Step, SetNumbers], rivals: Sequence[Rival]
) -> JointFound:
    """The answer of a joint with how sure its numbers are.

    Args:
        own: of its own set. exchanged: of those after an exchange that it can make. rivals: of the machine.
    """
    able = [rival for rival in rivals if rival.step in exchanged]
    exchanges = tuple(Exchange(r.step.leaves, r.step.joins, r.odds, exchanged[r.step]) for r in able)
    return replace(joint, numbers=own, exchanges=exchanges)
