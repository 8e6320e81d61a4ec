"""From which size on an effect would have been named: what the answer "no cause" is worth."""

from __future__ import annotations

from collections.abc import Sequence

from hqpipe.gap.answer.layer_causes import reporting
from hqpipe.identify.change import Changed
from hqpipe.identify.drifts import NOTABLE
from hqpipe.identify.found import JointFound, Number
from hqpipe.identify.model import Effect

UNUSUAL = 3.0  # spreads of the prior beyond which no machine is; as three standard deviations


def visible_from(joints: Sequence[JointFound], effect: str) -> str:
    """e.g. "; it would be named from 0.3 to 0.5 N·m on", empty where nothing can be said."""
    if any(_is_large(joint, effect) for joint in joints):
        return "; at a usual size it would not show in these logs"
    found = [number for joint in joints if (number := _visible(joint, effect)) is not None]
    if not found or len({number.unit for number in found}) != 1:
        return ""
    ends = [f"{pick(abs(number.value) for number in found):.2g}" for pick in (min, max)]
    unit = "" if found[0].unit == "1" else f" {found[0].unit}"
    return f"; it would be named from {' to '.join(dict.fromkeys(ends))}{unit} on"


def unseen_changes(joint: JointFound) -> list[str]:
    """A sentence if an effect of the joint may have changed notably without these logs showing it."""
    model = joint.model
    if joint.causes or not isinstance(model, Changed):
        return []
    found = []
    for effect in (effect for effect in model.effects if effect.name in joint.visible):
        then = abs(float(model.before(effect.name, joint.kept.values)[0]))
        share = joint.visible[effect.name] / then if then > 0.0 else 0.0
        if share > NOTABLE:
            found.append(f"{effect.name} by {share:.0%}")
    return [f"these logs would not show a change of {', of '.join(found)} or less"] if found else []


def _is_large(joint: JointFound, effect: str) -> bool:
    """Whether a joint would be given an effect only at a size that no data sheet would give."""
    spreads = [e.parameters[0].spread for e in joint.model.effects if e.name == effect]
    return effect in joint.visible and joint.visible[effect] > UNUSUAL * spreads[0]


def _visible(joint: JointFound, effect: str) -> Number | None:
    """The smallest size of an effect that would be named, in the form of diagnosis.json."""
    if effect not in joint.visible:
        return None
    known: dict[str, Effect] = {e.name: e for e in joint.model.effects}
    first = known[effect].parameters[0]
    size = joint.visible[effect]
    value = first.neutral + (size if first.neutral + size <= first.high else -size)
    if value < first.low:
        return None  # not even the largest would be
    plain = Number(first.name, first.unit, value, (value, value))
    told = reporting(joint.model)(effect, plain)
    return told if told != plain or first.neutral == 0.0 else None
