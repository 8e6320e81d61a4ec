"""Which effects a diagnosis of some logs could show, and which it could not tell apart, before any effect is fitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.layer_experiment import experiment_for, telling_apart
from hqpipe.gap.answer.layer_visible import reported_size
from hqpipe.gap.answer.second_channel import BIAS, LOG_PRESSURES, NULL_SHIFT
from hqpipe.gap.checks.left_out import LeftOut
from hqpipe.gap.intake import Intake, take_in
from hqpipe.gap.layer_diagnosis import NOT_JUDGED, apply_layer
from hqpipe.gap.layer_intake import LayerIntake, layer_intake
from hqpipe.gap.routing import ACTUATOR, route
from hqpipe.identify.found import Number
from hqpipe.identify.isolability import Isolability
from hqpipe.identify.joint_pool import JointPool
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.model import JointModel, LayerJoints
from hqpipe.identify.prior import prior_odds
from hqpipe.layers.actuator import Actuator
from hqpipe.logs.trajectory import LogSet
from hqpipe.machine import EFFECTS

_OVERFLOWS = "the base model's prediction overflows"


@dataclass(frozen=True)
class EffectShown:
    """What the inputs of a joint say beforehand of an effect.

    Attributes:
        shows: whether it would be named at a size that a machine may have.
        least: from which size on it would be, if nothing but the noise of the sensors were left besides.
        least_beside_base_error: the same beside all that the base leaves in these logs.
        usual: its size by a data sheet. The three are in the form of diagnosis.json; the first two are None where no size is
            enough, the last where the bounds of the fit exclude it.
        falls: whether a larger effect has a smaller number, as a limit.
        share_done_by_base: share of what it does that the free numbers of the base do as well; None where it does nothing by
            itself.
        alike: effects that could be taken for it. experiment: what to record so that it shows, where it does not.
    """

    joint: str
    effect: str
    shows: bool
    least: Number | None
    least_beside_base_error: Number | None
    usual: Number | None
    falls: bool
    share_done_by_base: float | None
    alike: tuple[str, ...]
    experiment: str | None


@dataclass(frozen=True)
class PairAlike:
    """Two effects that the inputs of some joints do not tell apart, and what to record so that they do."""

    effects: tuple[str, str]
    joints: tuple[str, ...]
    experiment: str


@dataclass(frozen=True)
class LayerEffects:
    """One layer of the diagnosis.

    Attributes:
        layer: its name. joints: that it judges. effects: of each joint. pairs: that are not told apart.
        left_out: joints and trials that it does without. not_sought: effect of the library → why no fit of this layer looks for
            it. reason: why it can judge none of the joints; None where it judges some.
    """

    layer: str
    joints: tuple[str, ...] = ()
    effects: tuple[EffectShown, ...] = ()
    pairs: tuple[PairAlike, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    not_sought: dict[str, str] = field(default_factory=dict)
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class _Asked:
    """A layer, the logs that it is asked about after they were looked through, and what they had to do without."""

    layer: Any
    log_set: LogSet
    left_out: tuple[LeftOut, ...]
    window_s: float | None = None


def effects_shown(log_set: LogSet, workers: int = 1) -> list[LayerEffects]:
    """What each layer that `hqpipe diagnose` would evaluate could show; one that can judge no joint has the reason.

    Args:
        workers: joints at a time.

    Raises:
        IdentificationError: the logs cannot be diagnosed.
    """
    found, refused = [], []
    for asked in _layers_asked(log_set):
        try:
            joints = asked.layer.joints(asked.log_set, asked.window_s)
        except IdentificationError as error:
            refused.append(error)
            found.append(LayerEffects(asked.layer.NAME, left_out=asked.left_out, reason=str(error)))
        else:
            found.append(_layer_effects(asked, joints, workers))
    if len(refused) == len(found):
        raise refused[0]
    return found


def _layers_asked(log_set: LogSet) -> list[_Asked]:
    """The law from command to torque and the layer that answers where there is none, or where it does not hold."""
    chosen = route(log_set)
    lacking = {name: apply_layer(name).lacking(log_set) for name in chosen.layers}
    name = next((name for name in chosen.layers if not lacking[name]), None)
    if chosen.actuator:
        intake = take_in(log_set, None)
        _require_sound(intake)
        law = Actuator(unsigned=intake.signed.joints)
        asked = [_Asked(law, intake.log_set, intake.left_out, intake.window.seconds)]
        return asked + ([_Asked(apply_layer(name), intake.signed.raw, intake.left_out)] if name is not None else [])
    if name is None:
        needs = "; ".join(f"layer {layer} needs {', '.join(what)}" for layer, what in lacking.items())
        raise IdentificationError(f"{log_set.path}: {needs}", file=log_set.path, fix="record what is missing")
    alone = layer_intake(name, log_set)
    _require_sound(alone)
    return [_Asked(apply_layer(name), alone.log_set, alone.left_out)]


def _require_sound(intake: Intake | LayerIntake) -> None:
    """
    Raises:
        IdentificationError: nothing can be said of the logs.
    """
    if not intake.reasons:
        return
    path, reason = intake.log_set.path, intake.reasons[0]
    fixed = any(reason.endswith(item.fix) for item in intake.left_out)  # the reason says what to do already
    raise IdentificationError(f"{path}: {reason}", file=path, fix=None if fixed else intake.advice)


def _layer_effects(asked: _Asked, joints: LayerJoints, workers: int) -> LayerEffects:
    with JointPool([JointSearch(model, prior_odds) for model in joints.models], workers) as pool:
        each_joint = pool.each("isolability")
    log_set = asked.log_set
    compared = log_set.trials[0].trajectory.pressure_a is not None
    found = [(model, effects) for model, effects in zip(joints.models, each_joint, strict=True) if effects]
    overflowing = {
        model.joint: _OVERFLOWS
        for model, effects in zip(joints.models, each_joint, strict=True)
        if not effects and any(effect.named for effect in model.effects)
    }
    effects = [
        _effect_shown(model, asked.layer, name, each, compared, log_set.kinds.get(model.joint))
        for model, by_effect in found
        for name, each in by_effect.items()
    ]
    return LayerEffects(
        layer=joints.layer,
        joints=tuple(model.joint for model in joints.models if model.joint not in overflowing),
        effects=tuple(effects),
        pairs=_pairs(log_set, joints.layer, effects),
        left_out=(*asked.left_out, *_not_judged({**joints.left, **overflowing})),
        not_sought=_not_sought(log_set, joints) if isinstance(asked.layer, Actuator) else {},
    )


def _not_judged(reasons: Mapping[str, str]) -> Iterator[LeftOut]:
    """Joints that a layer cannot judge, which cost no trial; reasons: of each."""
    return (LeftOut((), (joint,), None, NOT_JUDGED, reason, "") for joint, reason in reasons.items())


def _effect_shown(
    model: JointModel, layer: Any, name: str, found: Isolability, compared: bool, kind: str | None
) -> EffectShown:
    """
    Args:
        compared: whether the log holds pressures, which tell an offset of the torque from one of the command.
        kind: of the joint, revolute or prismatic; None where nobody says.
    """
    spread = next(effect for effect in model.effects if effect.name == name).parameters[0].spread

    def reported(size: float | None) -> Number | None:
        return None if size is None else reported_size(model, name, size, layer)

    small, large = reported(0.25 * spread), reported(0.5 * spread)
    settled = {BIAS, NULL_SHIFT} if compared and name in (BIAS, NULL_SHIFT) else set()
    return EffectShown(
        joint=model.joint,
        effect=name,
        shows=found.shows,
        least=reported(found.least),
        least_beside_base_error=reported(found.least_beside_base_error),
        usual=reported(spread),
        falls=small is not None and large is not None and abs(large.value) < abs(small.value),
        share_done_by_base=found.share_done_by_base,
        alike=tuple(other for other in found.alike if other not in settled),
        experiment=None if found.shows else experiment_for(name, layer.NAME, kind),
    )


def _pairs(log_set: LogSet, layer: str, effects: Sequence[EffectShown]) -> tuple[PairAlike, ...]:
    joints: dict[tuple[str, str], list[str]] = {}
    order = list(dict.fromkeys(effect.effect for effect in effects))
    for effect in effects:
        for other in effect.alike:
            one, two = sorted((effect.effect, other), key=order.index)
            own = joints.setdefault((one, two), [])
            if effect.joint not in own:
                own.append(effect.joint)
    return tuple(PairAlike(pair, tuple(own), _experiment(log_set, layer, pair, own)) for pair, own in joints.items())


def _experiment(log_set: LogSet, layer: str, pair: tuple[str, str], joints: Sequence[str]) -> str:
    kinds = {log_set.kinds.get(joint) for joint in joints}
    text = telling_apart(pair, layer, kinds.pop() if len(kinds) == 1 else None)
    offsets = layer == ACTUATOR and set(pair) == {BIAS, NULL_SHIFT} and log_set.effort_source != "pressure"
    return f"{LOG_PRESSURES}, or {text}" if offsets else text


def _not_sought(log_set: LogSet, joints: LayerJoints) -> dict[str, str]:
    """Effects of the library that no fit of the law from commanded position to torque looks for in these logs, and why."""
    searched = {effect.name for model in joints.models for effect in model.effects}
    found = {}
    for name, effect in EFFECTS.items():
        if name in searched:
            continue
        if effect.multiplies:
            of = ", ".join(effect.multiplies)
            beside = "beside earlier logs (--reference)"
            if effect.turns_friction:
                beside += ", or where friction is seen by a load cell, by the travel in which it turns round"
            found[name] = f"it only multiplies {of} of the base; it shows {beside}"
        elif effect.effort_sources and log_set.effort_source not in effect.effort_sources:
            found[name] = f"it acts on the torque only with effort_source: {' or '.join(effect.effort_sources)}"
        elif len(log_set.joints) < effect.least_joints:
            found[name] = f"it takes {effect.least_joints} joints"
    return found
