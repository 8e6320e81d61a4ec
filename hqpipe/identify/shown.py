"""Effects that show in what the causes of a joint leave, as a vibration that falling friction alone feeds.

What such an effect does begins from nothing: no law that is driven by logged motion predicts its course, and it closes none of
the error. The sign itself is the evidence, and says nothing of the size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hqpipe.identify.found import JointCause, JointFound
from hqpipe.identify.thresholds import CONFUSED
from hqpipe.identify.vibration_left import VibrationLeft, vibration_left

SURE = 1.0 - CONFUSED
"""Probability of an effect whose sign is shown; assumption: no other reason for the sign is so likely that it would be listed
beside it. Seen: 51 joints of another simulator whose errors vibrate, which all have the effect as a fault, and none of 330
others."""


def with_shown(answers: Sequence[JointFound]) -> list[JointFound]:
    """The answers of joints, with what shows in what their causes leave."""
    return [_with(joint, _vibration(joint)) for joint in answers]


def _vibration(joint: JointFound) -> VibrationLeft | None:
    """What is left of a vibration, where it would show an effect that is no cause of the joint yet."""
    effect = _feeding(joint)
    if not effect or effect in {cause.effect for cause in joint.causes}:
        return None
    return vibration_left(joint.kept.error, joint.model.fit)


def _feeding(joint: JointFound) -> str:
    """The effect that a vibration shows."""
    # Of its class: a model that wraps another one compares other logs than that.
    return joint.model.vibration_shows if hasattr(type(joint.model), "vibration_shows") else ""


def _with(joint: JointFound, vibration: VibrationLeft | None) -> JointFound:
    if vibration is None:
        return joint
    effect = _feeding(joint)
    return replace(
        joint,
        causes=(*joint.causes, JointCause(effect, SURE, (), shown_by=vibration.text(joint.model.unit))),
        without={**joint.without, effect: joint.named},
        probabilities={**joint.probabilities, effect: SURE},
    )
