"""Joints that a diagnosis left out, in the actuator model that it writes: a simulator needs all of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.errors import IdentificationError
from hqpipe.gap.intake import Intake
from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.least_squares import Fitter
from hqpipe.layers.actuator import Actuator
from hqpipe.logs.trajectory import LogSet


def whole_actuator(
    actuator: Augmented, intake: Intake, joints: Sequence[str], effort_limit: np.ndarray | None = None
) -> Augmented | None:
    """The actuator with the joints that were left out: without effects, fitted to what is sound of their logs.

    Args:
        actuator: of the joints that were answered. intake: of their logs. joints: of the machine, in order.
        effort_limit: (J,) N·m, of `joints`.

    Returns:
        None where a joint has no sound logs, mended or of other trials, to fit it to.
    """
    rows = _all_rows(dict(zip(actuator.joints, actuator.parameters, strict=True)), intake, joints, effort_limit)
    return None if rows is None else Augmented(tuple(joints), rows, actuator.dt)


def _all_rows(
    known: dict[str, np.ndarray], intake: Intake, joints: Sequence[str], effort_limit: np.ndarray | None
) -> np.ndarray | None:
    """(J, WIDTH) of all joints of the machine, see `whole_actuator`; known: joint → its row."""
    limits = {} if effort_limit is None else dict(zip(joints, map(float, effort_limit), strict=True))
    rows = []
    for joint in joints:
        row = known.get(joint)
        if row is None and (logs := intake.spare.get(joint)) is not None:
            row = _base_row(logs, intake.window.seconds, limits)
        if row is None:
            return None
        rows.append(row)
    return np.array(rows)


def _base_row(logs: LogSet, window_s: float, limits: dict[str, float]) -> np.ndarray | None:
    """(WIDTH,) the base of the only joint of the logs; None where it cannot be judged."""
    try:
        (joint,) = Actuator(limits).joints(logs, window_s).models
    except IdentificationError:
        return None
    return joint.row(base_solution(Fitter(joint)).values)


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
