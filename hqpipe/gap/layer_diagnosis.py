"""The diagnosis of a log set in one layer of `hqpipe.layers`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.gap.answer.diagnosis_files import Diagnosis, Row
from hqpipe.gap.answer.head import not_identifiable
from hqpipe.gap.answer.layer_answer import layer_content
from hqpipe.gap.answer.layer_causes import merge_causes, shares, unsigned_joints
from hqpipe.gap.answer.layer_verdict import weigh_layer
from hqpipe.gap.answer.layer_visible import unseen_changes
from hqpipe.gap.answer.second_channel import scale_errors, settle_offsets
from hqpipe.gap.change.since import FAMILIAR, EarlierLogs, EarlierModel
from hqpipe.gap.checks.cross_check import CrossCheck
from hqpipe.gap.checks.left_out import LeftOut, of_joints
from hqpipe.gap.residuals.beyond_fit import beyond_fit
from hqpipe.gap.residuals.layer_errors import LayerErrors, layer_errors
from hqpipe.gap.residuals.layer_traces import layer_traces
from hqpipe.gap.residuals.locate import Place, locate
from hqpipe.gap.residuals.tally import ALL
from hqpipe.identify.found import JointCause, JointFound, LayerFound
from hqpipe.identify.identify import Progress, identify
from hqpipe.identify.model import JointModel, LayerJoints
from hqpipe.layers import LAYERS
from hqpipe.logs.findings import listed
from hqpipe.logs.trajectory import LogSet
from hqpipe.registry import load

NOT_JUDGED = "not_judged"
AS_THEN = "the reference missed its own logs by as much"
MAY_BE_AS_THEN = "its interval holds what the reference says"
_FIX = "record what the reason says is missing"


def apply_layer(name: str) -> Any:
    """A layer by its name."""
    return load(LAYERS[name])()


def diagnose_layer(
    name: str,
    log_set: LogSet,
    window_s: float | None = None,
    without: Sequence[str] = (),
    workers: int = 1,
    progress: Progress | None = None,
    earlier: EarlierLogs | None = None,
    *,
    left_out: Sequence[LeftOut] = (),
    warnings: Sequence[str] = (),
) -> Diagnosis:
    """The answer of a layer.

    Args:
        name: of `hqpipe.layers`. log_set: with what the layer needs. left_out, warnings: so far; the others are as in
            `hqpipe.gap.diagnosis.diagnose`.

    Raises:
        UsageError: the earlier logs lack what the layer needs.
    """
    layer = apply_layer(name)
    if earlier is not None and hasattr(layer, "comparing"):
        layer = layer.comparing(log_set, earlier.log_set)
    try:
        then = earlier_joints(layer, name, earlier, window_s, without)
        joints = layer.joints(log_set, then.window_s if then is not None and window_s is None else window_s, without)
    except IdentificationError as error:
        advice = error.fix or "record longer trials in which every joint moves, one of them held out"
        return Diagnosis(not_identifiable(log_set, [error.message, *warnings], advice, earlier, left_out))
    if then is not None:
        joints = known_then(joints, then, earlier)
        if not joints.models:
            return Diagnosis(not_identifiable(log_set, [*joints.left.values(), *warnings], None, earlier, left_out))
    found = identify(joints, workers=workers, progress=progress, reference=then)
    since = None if then is None else Since(earlier, familiar_errors(found, then), unsigned_joints(then))
    return layer_diagnosis(layer, log_set, found, since, left_out, warnings)


@dataclass(frozen=True, eq=False)
class Since:
    """What a diagnosis of changes knows of the earlier record.

    Attributes:
        record: the earlier logs or model. familiar: (J,) mean squared error that the machine as it was may have on new logs.
        unsigned: joints whose torque had lost its sign there.
    """

    record: EarlierLogs | EarlierModel
    familiar: np.ndarray
    unsigned: tuple[str, ...] = ()


def layer_diagnosis(
    layer: Any,
    log_set: LogSet,
    found: LayerFound,
    since: Since | None = None,
    left_out: Sequence[LeftOut] = (),
    warnings: Sequence[str] = (),
    checked: Sequence[CrossCheck] = (),
) -> Diagnosis:
    """The answer from what was found.

    Args:
        layer: that gave the joints. since: where the question is what changed.
        checked: what a comparison with the pressures found.
    """
    joints, withdrawn = found.joints, {}
    errors = layer_errors(found, log_set)
    logs = of_joints(log_set, errors.names)
    evidence = weigh_layer(errors)
    if since is not None:
        familiar = since.familiar
        found, withdrawn = _only_changed(found, evidence.before <= familiar, isinstance(since.record, EarlierModel))
        errors = layer_errors(found, log_set)
        changed = np.array([bool(joint.causes) for joint in found.found])
        evidence = weigh_layer(errors, np.where(changed, np.minimum(familiar, evidence.after), familiar))
    compared = log_set.trials[0].trajectory.pressure_a is not None
    causes = settle_offsets(merge_causes(errors, joints, layer), checked, compared)
    before, after = (
        errors.tally([getattr(joint.found, name) for joint in errors.joints]) for name in ("base", "named")
    )
    rows, places = _rows(errors, before, after, evidence.floor)
    gone = [LeftOut((), (joint,), None, NOT_JUDGED, reason, _FIX) for joint, reason in joints.left.items()]
    content = layer_content(
        logs,
        joints,
        errors,
        evidence,
        causes,
        shares(errors, causes),
        tuple(joint for joint in unsigned_joints(joints) if since is None or joint not in since.unsigned),
        places,
        [*warnings, *_warnings_of(found)],
        since and since.record,
        [*left_out, *gone],
        withdrawn,
        scale_errors(checked),
        beyond_fit(log_set, errors.joints, joints.window_s),
    )
    return Diagnosis(content, tuple(rows), layer_traces(errors, logs, joints))


def earlier_joints(
    layer: Any, name: str, earlier: EarlierLogs | None, window_s: float | None, without: Sequence[str]
) -> LayerJoints | None:
    """The joints of earlier logs; None without them.

    Raises:
        UsageError: they lack what the layer needs. IdentificationError: no joint can be judged by them.
    """
    if earlier is None:
        return None
    if lacking := layer.lacking(earlier.log_set):
        raise UsageError(
            f"reference {earlier.log_set.path}: without {', '.join(lacking)}, which layer {name} needs",
            file=earlier.log_set.path,
            field=lacking[0],
            fix="give a reference with the same channels",
        )
    try:
        return layer.joints(earlier.log_set, window_s, without)
    except IdentificationError as error:
        raise IdentificationError(
            f"reference {earlier.log_set.path}: {error.message}",
            file=earlier.log_set.path,
            fix=error.fix or "give other logs",
        ) from error


def known_then(joints: LayerJoints, then: LayerJoints, earlier: EarlierLogs) -> LayerJoints:
    """The joints that earlier logs judge too; others are left with the reason."""
    known = {model.joint: model for model in then.models}
    path = earlier.log_set.path
    new = {}
    for model in joints.models:
        if model.joint not in known:
            new[model.joint] = f"cannot be judged in the reference {path}, so there is nothing to compare with"
        elif (unlike := _other_units(model, known[model.joint])) is not None:
            new[model.joint] = f"its numbers are in {unlike[0]} here and in {unlike[1]} in the reference {path}"
    kept = tuple(model for model in joints.models if model.joint not in new)
    return replace(joints, models=kept, left={**joints.left, **new})


def _other_units(now: JointModel, then: JointModel) -> tuple[str, str] | None:
    """Units in which the two differ: of the output, or of a number of the base; None where they are alike."""
    if now.unit != then.unit:
        return now.unit, then.unit
    units = {parameter.name: parameter.unit for parameter in then.base}
    pairs = [(parameter.unit, units.get(parameter.name, parameter.unit)) for parameter in now.base]
    return next((pair for pair in pairs if pair[0] != pair[1]), None)


def familiar_errors(found: LayerFound, then: LayerJoints) -> np.ndarray:
    """(J,) mean squared error that the machine as it was may have on new logs without anything having changed.

    What it left on its own logs, which come first in the samples of the fit; more where the output moves more, and not less
    where it moves less, for an error such as that of a friction does not shrink with the motion.
    """
    past = {model.joint: model.fit for model in then.models}
    levels = []
    for joint in found.found:
        old, new = past[joint.model.joint], joint.model.heldout if len(joint.model.heldout.time) else joint.model.fit
        error = np.mean(joint.base.error[: len(old.time)] ** 2)
        moved, moves = (float(np.mean((part.output - part.held) ** 2)) for part in (old, new))
        level = FAMILIAR * error * (max(moves / moved, 1.0) if moved > 0.0 else 1.0)
        levels.append(level if np.isfinite(level) else 0.0)
    return np.array(levels)


def _only_changed(found: LayerFound, unchanged: np.ndarray, by_model: bool) -> tuple[LayerFound, dict[str, str]]:
    """Without the causes of joints that are as they were; and why, by the names of these causes.

    With earlier logs a joint has changed if it errs more than it did then or if a number has changed for certain. Beside a
    model alone both are asked: its numbers had other motion to go by, which moves them by more than their intervals say.

    Args:
        unchanged: (J,) True for joints that err no more than they did then. by_model: the earlier record is a model alone.
    """
    joints, reasons = [], {}
    for joint, familiar in zip(found.found, unchanged, strict=True):
        certain = any(_has_changed(cause) for cause in joint.causes)
        same = (familiar or not certain) if by_model else (familiar and not certain)
        why = AS_THEN if familiar else MAY_BE_AS_THEN
        reasons |= {cause.effect: why for cause in joint.causes if same}
        none = same or not joint.causes  # what is left without a cause is all: no number may move for nothing
        joints.append(replace(joint, named=joint.base, causes=(), without={}) if none else joint)
    return replace(found, found=tuple(joints)), reasons


def _has_changed(cause: JointCause) -> bool:
    """Whether the interval of a number, which holds what differs from trial to trial, leaves out its earlier value."""
    earlier = ((n, 1.0 if n.reference is None else n.reference) for n in cause.numbers)  # a ratio is to what it was
    return any(not n.ci95[0] <= value <= n.ci95[1] for n, value in earlier)


def _rows(
    errors: LayerErrors, before: Any, after: Any, floor: np.ndarray
) -> tuple[list[Row], tuple[list[Place], list[Place]]]:
    """Rows of residuals.csv, all trials together and then trial by trial; and the places before and after."""
    units = dict(zip(errors.names, errors.units, strict=True))
    held = {
        joint.name: float(np.sqrt(np.mean((joint.samples.output - joint.samples.held) ** 2))) for joint in errors.joints
    }

    def located(one: Any, two: Any) -> tuple[list[Place], list[Place]]:
        return locate(one, floor, errors.names, errors.scale), locate(two, floor, errors.names, errors.scale)

    def paired(trial: str, places: tuple[list[Place], list[Place]]) -> list[Row]:
        known = {(p.joint, p.family, p.regime): p for p in places[1]}
        return [Row(trial, p, known.get((p.joint, p.family, p.regime)), units[p.joint]) for p in places[0]]

    whole = located(before, after)
    rows = [
        replace(row, held=held[row.before.joint]) if row.before.family == ALL else row for row in paired("all", whole)
    ]
    for index in np.unique(errors.trial_of_block):
        rows += paired(errors.files[index], located(before.of_trial(index), after.of_trial(index)))
    return rows, whole


def _remarks(joint: JointFound) -> Sequence[str]:
    """What the numbers of a joint say beside the parameters of its causes, if its model has a word for it."""
    remarks = getattr(joint.model, "remarks", None)
    return remarks([cause.effect for cause in joint.causes], joint.kept.values) if remarks is not None else ()


def _warnings_of(found: LayerFound) -> list[str]:
    """Warnings of the layer, notes of its joints with the joints that share one, drifts, and joints that were left."""
    joints = found.joints
    notes: dict[str, list[str]] = {}
    for joint in found.found:
        for note in (*joint.model.notes, *_remarks(joint), *joint.drifts, *unseen_changes(joint)):
            notes.setdefault(note.removeprefix(f"{joint.model.joint}: "), []).append(joint.model.joint)
    left: dict[str, list[str]] = {}
    for joint, reason in joints.left.items():
        left.setdefault(reason, []).append(joint)
    return [
        *joints.warnings,
        *(f"{listed(names)}: {note}" for note, names in notes.items()),
        *(f"{listed(names)} left out: {reason}" for reason, names in left.items()),
    ]
