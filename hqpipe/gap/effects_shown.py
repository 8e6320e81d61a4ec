"""Which effects the layers of a diagnosis could show in some logs, and which they could not tell apart: said before it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.layer_experiment import telling_apart
from hqpipe.gap.answer.layer_visible import told_size
from hqpipe.gap.answer.second_channel import BIAS, LOG_PRESSURES, NULL_SHIFT
from hqpipe.gap.intake import take_in
from hqpipe.gap.layer_diagnosis import apply_layer
from hqpipe.gap.layer_intake import layer_intake
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


@dataclass(frozen=True)
class EffectShown:
    """What the inputs of a joint say beforehand of an effect.

    Attributes:
        shows: whether it would be named at a size that a machine may have. least: from which size on it would be, if nothing
            but the noise of the sensors were left besides; beside: the same beside all that the base leaves in these logs;
            usual: its size by a data sheet; in the form of diagnosis.json, None where there is none.
        falls: whether a larger effect has a smaller number, as a limit.
        taken: share of what it does that the free numbers of the base do as well; None where it does nothing by itself.
        alike: effects that could be taken for it. experiment: what to record so that it shows, where it does not.
    """

    joint: str
    effect: str
    shows: bool
    least: Number | None
    beside: Number | None
    usual: Number | None
    falls: bool
    taken: float | None
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
        left: joint → why it cannot be judged. not_sought: effect of the library → why no fit of this layer looks for it.
    """

    layer: str
    joints: tuple[str, ...]
    effects: tuple[EffectShown, ...]
    pairs: tuple[PairAlike, ...]
    left: dict[str, str]
    not_sought: dict[str, str]


def effects_shown(log_set: LogSet, workers: int = 1) -> list[LayerEffects]:
    """What each layer that `hqpipe diagnose` would evaluate could show.

    Args:
        workers: joints at a time.

    Raises:
        IdentificationError: the logs cannot be diagnosed.
    """
    return [_layer_effects(logs, layer, joints, workers) for logs, layer, joints in _joints_asked(log_set)]


def _joints_asked(log_set: LogSet) -> Iterator[tuple[LogSet, Any, LayerJoints]]:
    """Logs that were looked through, layer and joints, of the law from command to torque and of the layer that answers where
    there is none, or where it does not hold."""
    chosen = route(log_set)
    lacking = {name: apply_layer(name).lacking(log_set) for name in chosen.layers}
    name = next((name for name in chosen.layers if not lacking[name]), None)
    if chosen.actuator:
        intake = take_in(log_set, None)
        _require(not intake.reasons, log_set, intake.warnings, intake.advice)
        law, second = Actuator(unsigned=intake.signed.joints), None if name is None else apply_layer(name)
        asked = [(intake.log_set, law, intake.window.seconds)]
        asked += [(intake.signed.raw, second, None)] if second is not None else []
        refused = []
        for logs, layer, window_s in asked:
            try:
                yield logs, layer, layer.joints(logs, window_s)
            except IdentificationError as error:
                refused.append(error)
        if len(refused) == len(asked):
            raise refused[0]
        return
    told = [f"layer {layer} needs {', '.join(what)}" for layer, what in lacking.items()]
    _require(name is not None, log_set, told, "record what is missing")
    alone = layer_intake(name, log_set)
    _require(not alone.reasons, log_set, alone.warnings, alone.advice)
    yield alone.log_set, (layer := apply_layer(name)), layer.joints(alone.log_set)


def _require(sound: bool, log_set: LogSet, reasons: Sequence[str], advice: str | None) -> None:
    if not sound:
        raise IdentificationError(f"{log_set.path}: {reasons[0]}", file=log_set.path, fix=advice)


def _layer_effects(log_set: LogSet, layer: Any, joints: LayerJoints, workers: int) -> LayerEffects:
    with JointPool([JointSearch(model, prior_odds) for model in joints.models], workers) as pool:
        found = pool.each("isolability")
    compared = log_set.trials[0].trajectory.pressure_a is not None
    effects = [
        _shown(model, layer, name, each, compared)
        for model, each_effect in zip(joints.models, found, strict=True)
        for name, each in each_effect.items()
    ]
    names = tuple(model.joint for model in joints.models)
    searched = {effect.name for model in joints.models for effect in model.effects}
    not_sought = _not_sought(log_set, searched) if joints.layer == ACTUATOR else {}
    return LayerEffects(
        joints.layer, names, tuple(effects), _pairs(log_set, joints.layer, effects), joints.left, not_sought
    )


def _shown(model: JointModel, layer: Any, name: str, found: Isolability, compared: bool) -> EffectShown:
    """
    Args:
        compared: whether the log holds pressures, which tell an offset of the torque from one of the command.
    """
    first = next(effect for effect in model.effects if effect.name == name).parameters[0]

    def told(size: float | None) -> Number | None:
        return None if size is None else told_size(model, name, size, layer)

    usual, larger = told(first.spread), told(1.5 * first.spread)
    settled = {BIAS, NULL_SHIFT} if compared and name in (BIAS, NULL_SHIFT) else set()
    return EffectShown(
        joint=model.joint,
        effect=name,
        shows=found.shows,
        least=told(found.least),
        beside=told(found.beside),
        usual=usual,
        falls=usual is not None and larger is not None and abs(larger.value) < abs(usual.value),
        taken=found.taken,
        alike=tuple(other for other in found.alike if other not in settled),
        experiment=EFFECTS[name].experiment if not found.shows and name in EFFECTS else None,
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
    return tuple(PairAlike(pair, tuple(own), _experiment(log_set, layer, pair)) for pair, own in joints.items())


def _experiment(log_set: LogSet, layer: str, pair: tuple[str, str]) -> str:
    text = telling_apart(pair, layer)
    offsets = layer == ACTUATOR and set(pair) == {BIAS, NULL_SHIFT} and log_set.effort_source != "pressure"
    return f"{LOG_PRESSURES}, or {text}" if offsets else text


def _not_sought(log_set: LogSet, searched: set[str]) -> dict[str, str]:
    """Effects of the library that no fit of the law from command to torque looks for in these logs, and why."""
    found = {}
    for name, effect in EFFECTS.items():
        if name in searched:
            continue
        if effect.multiplies:
            of = ", ".join(effect.multiplies)
            found[name] = f"it only multiplies {of} of the base; it shows as a change beside earlier logs (--reference)"
        elif effect.effort_sources and log_set.effort_source not in effect.effort_sources:
            found[name] = f"it acts on the torque only with effort_source: {' or '.join(effect.effort_sources)}"
        elif len(log_set.joints) < effect.least_joints:
            found[name] = f"it takes {effect.least_joints} joints"
    return found
