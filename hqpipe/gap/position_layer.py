"""The diagnosis of joints whose position is commanded and whose torque is measured: the law, its effects, and the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer import not_identifiable
from hqpipe.gap.diagnosis_files import Diagnosis
from hqpipe.gap.intake import LONGER, Intake
from hqpipe.gap.joint_state import Progress
from hqpipe.gap.layer_diagnosis import layer_diagnosis
from hqpipe.gap.left_joints import plain_joints, whole_machine
from hqpipe.gap.row_model import RowModel
from hqpipe.gap.second_channel import measured
from hqpipe.identify.found import LayerFound
from hqpipe.identify.identify import identify
from hqpipe.identify.passing import PassingJoint
from hqpipe.layers.actuator import Actuator

POSITION = "position"


def diagnose_position(
    intake: Intake,
    machine: tuple[str, ...],
    without: Sequence[str] = (),
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Diagnosis:
    """The answer of the actuator layer in control mode position, without an earlier record of the machine.

    Args:
        intake: of the logs. machine: joints of the logs as they came; `effort_limit`, N·m, is of these. The others are as in
            `hqpipe.gap.diagnosis.diagnose`.
    """
    log_set, told = intake.log_set, [*intake.warnings, *intake.stops]
    if intake.reasons:
        return Diagnosis(not_identifiable(log_set, told, intake.advice, None, intake.left_out))
    limits = {} if effort_limit is None else dict(zip(machine, map(float, effort_limit), strict=True))
    layer = Actuator(limits, intake.signed.joints)
    try:
        joints = replace(layer.joints(log_set, intake.window.seconds, without), window_reason=intake.window.reason)
    except IdentificationError as error:
        return Diagnosis(not_identifiable(log_set, [error.message, *told], error.fix or LONGER, None, intake.left_out))
    found = identify(joints, workers=workers, progress=progress)
    base, augmented = (_model(found, name) for name in ("base", "named"))
    base, augmented = (whole_machine(one, intake, machine, effort_limit) for one in (base, augmented))
    told += plain_joints(intake, machine, augmented is not None)
    checked = measured(log_set, without)
    answered = layer_diagnosis(layer, log_set, found, left_out=intake.left_out, warnings=told, checked=checked)
    models = [model and model.actuator() for model in (base, augmented)]
    return Diagnosis(answered.content, answered.table, answered.traces, *models, law=answered.content["gap"])


def _model(found: LayerFound, name: str) -> RowModel:
    """The machine with the base or the named causes of its joints; a simulator knows no causes that act for some time only."""
    rows = [
        joint.model.row((joint.base if isinstance(joint.model, PassingJoint) else getattr(joint, name)).values)
        for joint in found.found
    ]
    return RowModel(tuple(joint.model.joint for joint in found.found), np.array(rows), POSITION)
