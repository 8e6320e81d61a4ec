"""The diagnosis of joints whose position is commanded and whose torque is measured: the law, its effects, and the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.actuators.augmented import OF_THE_LOG, Augmented
from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.diagnosis_files import Diagnosis
from hqpipe.gap.answer.head import not_identifiable
from hqpipe.gap.answer.second_channel import measured
from hqpipe.gap.change.position_record import PositionRecord
from hqpipe.gap.change.since import EarlierModel
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.gap.intake import LONGER, Intake
from hqpipe.gap.layer_diagnosis import Since, familiar_errors, known_then, layer_diagnosis
from hqpipe.gap.left_joints import left_joints, plain_joints, whole_actuator
from hqpipe.gap.model_posterior import diagnosed_posterior
from hqpipe.identify.change import Changed, KnownJoint
from hqpipe.identify.found import JointFound, LayerFound
from hqpipe.identify.identify import Progress, identify
from hqpipe.identify.model import LayerJoints
from hqpipe.identify.passing import modelled
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.joint import ActuatorJoint


def diagnose_position(
    intake: Intake,
    machine: tuple[str, ...],
    without: Sequence[str] = (),
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    earlier: PositionRecord | EarlierModel | None = None,
) -> Diagnosis:
    """The answer of the actuator layer in control mode position.

    Args:
        intake: of the logs. machine: joints of the logs as they came; `effort_limit`, N·m, is of these.
        earlier: a record of the same machine; then only what changed since is a cause. The others are as in
            `hqpipe.gap.diagnosis.diagnose`.
    """
    log_set, told = intake.log_set, [*intake.warnings, *intake.stops]
    record = earlier.logs if isinstance(earlier, PositionRecord) else earlier
    if intake.reasons:
        return Diagnosis(not_identifiable(log_set, told, intake.advice, record, intake.left_out))
    limits = {} if effort_limit is None else dict(zip(machine, map(float, effort_limit), strict=True))
    layer = Actuator(
        limits, intake.signed.joints, earlier.intake.log_set if isinstance(earlier, PositionRecord) else None
    )
    try:
        joints = replace(layer.joints(log_set, intake.window.seconds, without), window_reason=intake.window.reason)
    except IdentificationError as error:
        return Diagnosis(
            not_identifiable(log_set, [error.message, *told], error.fix or LONGER, record, intake.left_out)
        )
    joints, then = _beside(joints, earlier)
    if not joints.models:
        return Diagnosis(not_identifiable(log_set, [*joints.left.values(), *told], LONGER, record, intake.left_out))
    found = identify(joints, workers=workers, progress=progress, reference=then, covariances=then is None)
    left = left_joints(intake, machine, [joint.model.joint for joint in found.found], effort_limit)
    base, augmented = (whole_actuator(_actuator(found, name), left, machine) for name in ("base", "named"))
    told += plain_joints(intake, machine, augmented is not None)
    since = _since(found, earlier)
    known = earlier.measured if isinstance(earlier, PositionRecord) else frozenset()
    checked = [check for check in measured(log_set, without) if (check.effect, check.joint) not in known]
    answered = layer_diagnosis(layer, log_set, found, since, intake.left_out, told, checked)
    listed = {(cause["effect"], rival) for cause in answered.content["causes"] for rival in cause["confused_with"]}
    has_posterior = augmented is not None and then is None
    posterior = diagnosed_posterior(found, left, augmented, listed) if has_posterior else None
    models = {"base": base, "augmented": augmented, "posterior": posterior}
    return Diagnosis(answered.content, answered.table, answered.traces, **models, law=answered.content["gap"])


def _beside(
    joints: LayerJoints, earlier: PositionRecord | EarlierModel | None
) -> tuple[LayerJoints, LayerJoints | dict[str, KnownJoint] | None]:
    """The joints that an earlier record knows, and what it says of them."""
    if earlier is None:
        return joints, None
    if isinstance(earlier, PositionRecord):
        return known_then(joints, earlier.joints, earlier.logs), earlier.joints
    pairs = [earlier.beside(model) for model in joints.models]
    models = tuple(model for model, _ in pairs)
    return replace(joints, models=models), {model.joint: known for model, known in pairs}


def _since(found: LayerFound, earlier: PositionRecord | EarlierModel | None) -> Since | None:
    if earlier is None:
        return None
    if isinstance(earlier, PositionRecord):
        return Since(earlier.logs, familiar_errors(found, earlier.joints), earlier.intake.signed.joints)
    familiar = []
    for joint in found.found:
        part = joint.model.heldout if len(joint.model.heldout.time) else joint.model.fit
        familiar.append(earlier.familiar(joint.model.joint, float(np.mean((part.output - part.held) ** 2))))
    return Since(earlier, np.array(familiar))


def _actuator(found: LayerFound, name: str) -> Augmented:
    """The joints with their `base` or their `named` causes, for a simulator.

    It knows no causes that act for some time only, and what a sensor shows is no part of it.
    """
    pairs = [_numbers(joint, name) for joint in found.found]
    return FittedJoints.of([model for model, _ in pairs], [values for _, values in pairs]).actuator()


def _numbers(joint: JointFound, name: str) -> tuple[ActuatorJoint, np.ndarray]:
    """The joint as the logs have it, and its numbers."""
    model, values = joint.model, getattr(joint, name).values
    if isinstance(model, Changed):
        numbers = model.then_values(values) if name == "base" else model.now_values(values, OF_THE_LOG)
        return model.both.now, numbers
    return model, modelled(joint).values if name == "named" else values
