"""Joints that a diagnosis left out, in the actuator model that it writes: a simulator needs all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.gap.intake import Intake
from hqpipe.gap.joint_data import joint_data
from hqpipe.gap.row_model import RowModel
from hqpipe.gap.set_fit import JointFitter


def whole_machine(
    model: RowModel, intake: Intake, joints: Sequence[str], effort_limit: np.ndarray | None = None
) -> RowModel | None:
    """The model with the joints that were left out: without effects, fitted to what is sound of their logs.

    Args:
        model: of the joints that were answered. intake: of their logs. joints: of the machine, in order.
        effort_limit: (J,) N·m, of `joints`.

    Returns:
        None where a joint has no sound logs, mended or of other trials, to fit it to.
    """
    rows = dict(zip(model.joints, model.rows, strict=True))
    for joint in (joint for joint in joints if joint not in rows):
        logs = intake.spare.get(joint)
        if logs is None:
            return None
        fit = [trial.trajectory for trial in logs.fit if trial.trajectory.samples > intake.steps]
        if not fit:
            return None
        limit = np.inf if effort_limit is None else float(effort_limit[list(joints).index(joint)])
        data = joint_data(fit, fit, 0, model.mode, intake.steps, 0.0, limit, model.speed)
        rows[joint] = JointFitter(data).fit().row
    spans = {list(joints).index(model.joints[j]): span for j, span in model.spans.items()}
    return replace(model, joints=tuple(joints), rows=np.array([rows[joint] for joint in joints]), spans=spans)


def plain_joints(intake: Intake, joints: Sequence[str], written: bool) -> list[str]:
    """What to know of the model's joints that were left out.

    Args:
        joints: of the machine. written: whether there is a model of all of them.
    """
    lacking = [joint for joint in joints if joint not in intake.log_set.joints]
    if not lacking:
        return []
    names = ", ".join(lacking)
    if written:
        return [f"actuator.json: {names} without effects, fitted to what is sound of their logs, or to corrected ones"]
    return [f"no actuator.json: no sound logs of {names} to fit; correct them, or train with the model of fit-actuator"]
