"""Effects that the logs of a joint show by themselves, as a vibration that falling friction alone feeds.

What such an effect does begins from nothing: no law that is driven by logged motion predicts its course, and it closes none of
the error. The sign itself is the evidence, and says nothing of the size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.identify.found import JointCause, JointFound
from hqpipe.identify.model import Shown
from hqpipe.identify.thresholds import CONFUSED, HALVED

SURE = 1.0 - CONFUSED
"""Probability of an effect whose sign is shown; assumption: no other reason for the sign is so likely that it would be listed
beside it. Seen: 23 of 24 joints of another simulator that vibrate have the effect as a fault, and one a little of it."""


def with_shown(answers: Sequence[JointFound]) -> list[JointFound]:
    """The answers of joints, with what their logs show and their causes do not explain."""
    return [_with(joint, _unexplained(joint)) for joint in answers]


def _unexplained(joint: JointFound) -> list[Shown]:
    """What the logs show of effects that are no causes of the joint yet, and is still in what its causes leave."""
    # Of its class: a model that wraps another one compares other logs than that.
    shown = joint.model.shown if hasattr(type(joint.model), "shown") else ()
    left = float(np.mean(joint.kept.error**2)) if shown and len(joint.kept.error) else 0.0
    named = {cause.effect for cause in joint.causes}
    return [each for each in shown if each.effect not in named and left >= HALVED * each.square]


def _with(joint: JointFound, shown: Sequence[Shown]) -> JointFound:
    if not shown:
        return joint
    effects = [each.effect for each in shown]
    return replace(
        joint,
        causes=(*joint.causes, *(JointCause(each.effect, SURE, (), shown_by=each.text) for each in shown)),
        without={**joint.without, **dict.fromkeys(effects, joint.named)},
        probabilities={**joint.probabilities, **dict.fromkeys(effects, SURE)},
    )
