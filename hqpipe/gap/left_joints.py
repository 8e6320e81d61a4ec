"""Joints that a diagnosis left out, in the actuator model that it writes: a simulator needs all of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.actuators.augmented import Augmented
from hqpipe.errors import IdentificationError
from hqpipe.gap.intake import Intake
from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.least_squares import Fitter
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.joint import ActuatorJoint
from hqpipe.logs.trajectory import LogSet


@dataclass(frozen=True, eq=False)
class PlainJoint:
    """A joint that was left out, without effects.

    Attributes:
        model: of its logs. values: (P,) of its parameters, see `hqpipe.identify.model.all_parameters`.
    """

    model: ActuatorJoint
    values: np.ndarray


def left_joints(
    intake: Intake, joints: Sequence[str], known: Collection[str], effort_limit: np.ndarray | None = None
) -> dict[str, PlainJoint]:
    """The joints that were left out, fitted to what is sound of their logs; those without any are not in it.

    Args:
        intake: of the logs. joints: of the machine, in order. known: those that were answered. effort_limit: (J,) N·m, of
            `joints`.
    """
    limits = {} if effort_limit is None else dict(zip(joints, map(float, effort_limit), strict=True))
    found = {}
    for joint in joints:
        if joint not in known and (logs := intake.spare.get(joint)) is not None:
            plain = _plain_joint(logs, intake.window.seconds, limits)
            if plain is not None:
                found[joint] = plain
    return found


def _plain_joint(logs: LogSet, window_s: float, limits: dict[str, float]) -> PlainJoint | None:
    """The only joint of the logs; None where it cannot be judged."""
    try:
        (joint,) = Actuator(limits).joints(logs, window_s).models
    except IdentificationError:
        return None
    return PlainJoint(joint, base_solution(Fitter(joint)).values)


def whole_actuator(actuator: Augmented, left: Mapping[str, PlainJoint], joints: Sequence[str]) -> Augmented | None:
    """The actuator with the joints that were left out.

    Args:
        actuator: of the joints that were answered. left: of `left_joints`. joints: of the machine, in order.

    Returns:
        None where a joint has no sound logs to fit it to, be they repaired or of other trials.
    """
    rows = dict(zip(actuator.joints, actuator.parameters, strict=True))
    rows = {name: plain.model.row(plain.values) for name, plain in left.items()} | rows
    if not all(joint in rows for joint in joints):
        return None
    return Augmented(tuple(joints), np.array([rows[joint] for joint in joints]), actuator.dt)


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
