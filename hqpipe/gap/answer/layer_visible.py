"""From which size on an effect would have been named: what the answer "no cause" is worth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hqpipe.gap.answer.layer_causes import reporting
from hqpipe.identify.change import Changed
from hqpipe.identify.drifts import NOTABLE
from hqpipe.identify.found import JointFound, Number
from hqpipe.identify.model import JointModel, Parameter
from hqpipe.identify.visible import UNUSUAL


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
    """The smallest size of an effect that would be named, in the form of diagnosis.json; None for a number that is reported as
    fitted and is not 0 without the effect."""
    if effect not in joint.visible:
        return None
    fitted = _fitted_size(joint.model, effect, joint.visible[effect])
    found = reported_size(joint.model, effect, joint.visible[effect])
    return None if found == fitted and _first(joint.model, effect).neutral != 0.0 else found


def reported_size(model: JointModel, effect: str, size: float, layer: Any = None) -> Number | None:
    """The first number of an effect of some size, in the form of diagnosis.json; None where its bounds exclude that size.

    Args:
        size: distance from neutral. layer: that gave the model, which may say how numbers are reported.
    """
    fitted = _fitted_size(model, effect, size)
    return None if fitted is None else reporting(model, layer)(effect, fitted)


def _fitted_size(model: JointModel, effect: str, size: float) -> Number | None:
    """The same in the form of the fit: above neutral, or below it where the upper bound is nearer."""
    first = _first(model, effect)
    value = first.neutral + (size if first.neutral + size <= first.high else -size)
    return Number(first.name, first.unit, value, (value, value)) if value >= first.low else None


def _first(model: JointModel, effect: str) -> Parameter:
    return next(e for e in model.effects if e.name == effect).parameters[0]
