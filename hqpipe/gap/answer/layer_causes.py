"""From what the joints of a layer were found to have to its causes: which joints share one, how large, how much it closes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.gap.answer.estimate import Estimate, agree
from hqpipe.gap.answer.scope import scope_of
from hqpipe.gap.answer.shapley import Shrink, shapley
from hqpipe.gap.checks.signs import NAME as UNSIGNED
from hqpipe.gap.residuals.layer_errors import LayerErrors
from hqpipe.identify.found import JointCause, Number
from hqpipe.identify.model import JointModel, LayerJoints
from hqpipe.identify.prior import MOST_JOINTS
from hqpipe.identify.uncertainty import NORMAL
from hqpipe.machine import EFFECTS

SENSING = "sensing"
ALIKE = 1.5  # between numbers told as one; assumption: what differs by more nobody would call the same
_NEAR = 1e-3  # of the way to the value, from an end of an interval that is infinite in the form that is reported


@dataclass(frozen=True, eq=False)
class LayerCause:
    """An effect of several joints that agree on its numbers.

    Attributes:
        members: joint → what was found in it. numbers: that half of the joints have at least, pooled over these.
    """

    effect: str
    layer: str
    scope: str
    members: dict[str, JointCause]
    numbers: tuple[Number, ...]
    rivals: tuple[str, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.members)

    @property
    def shown_by(self) -> str:
        """What shows it in the joints that no fit found it in, by joint if there are several; empty if there is none."""
        shown = {joint: cause.shown_by for joint, cause in self.members.items() if cause.shown_by}
        if len(self.members) == 1:
            return "".join(shown.values())
        return "; ".join(f"{joint}: {text}" for joint, text in shown.items())

    @property
    def probability(self) -> float:
        """Of the name: that of the middle one of its joints. One joint in which what the law leaves out speaks against a rival
        does not make the name sure in the others."""
        return float(np.median([cause.probability for cause in self.members.values()]))


def merge_causes(errors: LayerErrors, joints: LayerJoints, apart: Any = None) -> list[LayerCause]:
    """One cause for each effect and set of joints that could share its numbers, the most joints first.

    Args:
        joints: that were searched. apart: the layer, which may say how its numbers are reported, see `reporting`.
    """
    layer, models = joints.layer, {model.joint: model for model in joints.models}
    found: dict[str, dict[str, JointCause]] = {}
    for joint in errors.joints:
        for cause in joint.found.causes:
            known, reported = _without_absent(models[joint.name], cause), reporting(models[joint.name], apart)
            told = tuple(
                reported(cause.effect, number)
                for k, number in enumerate(known.numbers)
                if k == 0 or not _may_be_infinite(models[joint.name], apart, cause.effect, number)
            )
            numbers = told + _derived(cause.effect, told)
            found.setdefault(cause.effect, {})[joint.name] = replace(known, numbers=numbers)
    causes = []
    for effect, members in found.items():
        for batch in _batches(members):
            causes.append(_cause(effect, layer, {joint: members[joint] for joint in batch}, errors.names))
    return causes


def _without_absent(model: JointModel, cause: JointCause) -> JointCause:
    """The cause without numbers of an earlier record that say that it was absent there."""
    neutral = {p.name: p.neutral for effect in model.effects if effect.name == cause.effect for p in effect.parameters}
    if any(number.reference is None or number.reference != neutral.get(number.name) for number in cause.numbers):
        return cause
    return replace(cause, numbers=tuple(replace(number, reference=None) for number in cause.numbers))


def _may_be_infinite(model: JointModel, layer: Any, effect: str, number: Number) -> bool:
    """Whether a number as it is reported may be infinite: a limit that the joint never meets."""
    given = getattr(model, "reported", None) or getattr(layer, "reported", None)
    told = [given(effect, number.name, x)[1] for x in (number.value, *number.ci95)] if given else []
    return not np.isfinite(told).all()


def _derived(effect: str, told: Sequence[Number]) -> tuple[Number, ...]:
    """What follows from the numbers of an effect, where it has all that they need."""
    values, found = {number.name: number for number in told}, []
    for quantity in EFFECTS[effect].derived if effect in EFFECTS else ():
        if all(name in values for name in quantity.of):
            of = [values[name] for name in quantity.of]
            value, square = quantity.function(*(number.value for number in of)), 0.0
            for k in range(len(of)):
                ends = [
                    quantity.function(*(n.ci95[side] if i == k else n.value for i, n in enumerate(of)))
                    for side in (0, 1)
                ]
                square += (0.5 * (ends[1] - ends[0])) ** 2
            half = float(np.sqrt(square))
            if not np.isfinite([value, half]).all():
                continue
            found.append(Number(quantity.name, quantity.unit, value, (max(value - half, 0.0), value + half)))
    return tuple(found)


def unsigned_joints(joints: LayerJoints) -> tuple[str, ...]:
    """Joints whose torque lost its sign."""
    return tuple(model.joint for model in joints.models if getattr(model, "unsigned", False))


def layer_of(effect: str, layer: str) -> str:
    """The layer that an effect is reported in: a sensor's error is one of the sensor whatever layer shows it."""
    return SENSING if effect == UNSIGNED or (effect in EFFECTS and EFFECTS[effect].layer == SENSING) else layer


def _batches(members: dict[str, JointCause]) -> list[list[str]]:
    """Joints whose numbers agree; the largest batch first."""
    rest, batches = list(members), []
    while rest:
        around = [[j for j in rest if j == centre or _near(members[centre], members[j])] for centre in rest]
        best = max(around, key=len)
        batches.append(best)
        rest = [joint for joint in rest if joint not in best]
    return batches


def _near(a: JointCause, b: JointCause) -> bool:
    if [(n.name, n.unit) for n in a.numbers[:1]] != [(n.name, n.unit) for n in b.numbers[:1]]:
        return False
    others = {n.name: n for n in b.numbers}
    pairs = [(n, others[n.name]) for n in a.numbers if n.name in others]
    if any(one.unit != other.unit for one, other in pairs):
        return False
    if pairs and not 1.0 / ALIKE <= abs(pairs[0][0].value) / max(abs(pairs[0][1].value), 1e-300) <= ALIKE:
        return False
    return all(agree([_estimate(x), _estimate(y)]) for x, y in pairs)


def _estimate(number: Number) -> Estimate:
    low, high = number.ci95
    return Estimate(number.value, low, high, (high - low) / (2.0 * NORMAL))


def _cause(effect: str, layer: str, members: dict[str, JointCause], machine: Sequence[str]) -> LayerCause:
    shown = Counter((number.name, number.unit) for cause in members.values() for number in cause.numbers)
    numbers = [
        _pooled([n for cause in members.values() for n in cause.numbers if (n.name, n.unit) == key])
        for key, count in shown.items()
        if count >= MOST_JOINTS * len(members)
    ]
    counted = Counter(name for cause in members.values() for name in dict.fromkeys(cause.confused_with))
    rivals = tuple(name for name, count in counted.most_common() if count >= MOST_JOINTS * len(members))
    scope = scope_of(tuple(members), machine)
    return LayerCause(effect, layer_of(effect, layer), scope, members, tuple(numbers), rivals)


def _pooled(numbers: list[Number]) -> Number:
    """The mean of a number over joints, and its interval.

    Joints of one kind have numbers that scatter around what they share. Each is drawn to that by as much as its own logs leave
    open (empirical Bayes, Morris 1983; scatter by moments, DerSimonian and Laird 1986): precise joints that differ give their
    plain mean, joints that agree within their intervals the mean weighted by precision.
    They are no surer together than the middle one of those that know it: what errs in all alike, as the clock or the law, does
    not average out, and the smallest of several intervals is too small by chance.
    """
    if len(numbers) == 1:
        return numbers[0]
    parts = [_estimate(number) for number in numbers]
    values = np.array([part.value for part in parts])
    deviations = np.array([part.deviation for part in parts])
    known = np.abs(np.concatenate([values, deviations[np.isfinite(deviations)]]))
    least = np.finfo(float).eps * (float(np.max(known)) or 1.0)  # what rounding leaves, and what is not known at all
    own = np.clip(deviations, least, least / np.finfo(float).eps ** 2) ** 2
    weight = 1.0 / own
    excess = float(weight @ (values - weight @ values / weight.sum()) ** 2) - (len(parts) - 1)
    spare = float(weight.sum() - weight @ weight / weight.sum())
    scatter = max(excess, 0.0) / spare if spare > 0.0 else 0.0  # none where one joint knows everything
    weight = 1.0 / (own + scatter)
    shared, drawn = float(weight @ values / weight.sum()), own * weight
    value = float(np.mean(drawn * shared + (1.0 - drawn) * values))
    variance = np.sum((1.0 - drawn) * own) / len(parts) ** 2 + np.mean(drawn) ** 2 / weight.sum()
    finite = deviations[np.isfinite(deviations)]
    half = NORMAL * max(float(np.sqrt(variance)), float(np.median(finite)) if len(finite) else np.inf)
    then = [number.reference for number in numbers]
    mean = None if any(value is None for value in then) else float(np.mean(then))
    low, high = min(part.low for part in parts), max(part.high for part in parts)  # their bounds are its bounds
    return Number(numbers[0].name, numbers[0].unit, value, (max(value - half, low), min(value + half, high)), mean)


def shares(errors: LayerErrors, causes: Sequence[LayerCause]) -> Shrink:
    """How far each cause shrinks the pooled error.

    Of a joint with one or two causes every subset was fitted. Of more, the subsets between none and all but one were not: there
    each cause closes what it closes as the last one, in proportion, so that together they close what all do.
    """

    def of(subset: frozenset[int]) -> np.ndarray:
        total = np.zeros(len(errors.trial_of_block))
        for j, joint in enumerate(errors.joints):
            names = {causes[i].effect for i in subset if joint.name in causes[i].members}
            total += _error_of(errors, j, names)
        return total

    return shapley(len(causes), of)


def _error_of(errors: LayerErrors, j: int, names: set[str]) -> np.ndarray:
    """(B,) what a joint with some of its causes adds to the squared pooled error."""
    found = errors.joints[j].found
    every = [cause.effect for cause in found.causes]
    base, named = errors.relative(j, found.base), errors.relative(j, found.named)
    lacking = [name for name in every if name not in names]
    if not lacking:
        return named
    if len(lacking) == len(every):
        return base
    if len(lacking) == 1 and lacking[0] in found.without:
        return errors.relative(j, found.without[lacking[0]])
    last = {
        name: max(errors.relative(j, found.without[name]).sum() - named.sum(), 0.0) if name in found.without else 0.0
        for name in every
    }
    total = sum(last.values())
    part = sum(last[name] for name in names) / total if total > 0.0 else len(names) / len(every)
    return base + part * (named - base)


def reporting(model: JointModel, layer: Any = None) -> Callable[[str, Number], Number]:
    """How the numbers of a joint are reported: as fitted, unless its model or its layer offers `reported(effect, name, value)`.

    That gives name, value and unit in the form of diagnosis.json, as the limit of a drive for a share of its largest torque.
    """
    given = getattr(model, "reported", None) or getattr(layer, "reported", None)
    if given is None:
        return lambda effect, number: number

    def told(effect: str, number: Number) -> Number:
        def form(fitted: float) -> float:
            return float(given(effect, number.name, fitted)[1])

        name, value, unit = given(effect, number.name, number.value)
        inner = [
            end + _NEAR * (number.value - end) for end in number.ci95
        ]  # where the other form has no end, as of 1/0
        ends = sorted(
            x if np.isfinite(x := form(end)) else form(near) for end, near in zip(number.ci95, inner, strict=True)
        )
        if not np.isfinite([value, *ends]).all() or not ends[0] <= value <= ends[1]:
            return number
        then = None if number.reference is None else form(number.reference)
        then = then if then is not None and np.isfinite(then) else None
        return Number(name, unit, float(value), (ends[0], ends[1]), then)

    return told
