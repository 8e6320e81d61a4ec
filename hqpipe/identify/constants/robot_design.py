"""The design of hydraulic joints from what the robot's files say, where the logs put them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hqpipe.identify.constants.design import UNKNOWN, Design
from hqpipe.logs.trajectory import LogSet


def designs_at(
    log_set: LogSet, hydraulics: Mapping[str, Any], radius: Mapping[str, float], middle: Mapping[str, float]
) -> dict[str, Design]:
    """Joint of the logs → design, at the mean posture and valve opening of the fit trials.

    A joint of another machine has nothing but a radius of 1, and so has nothing to expect.

    Args:
        hydraulics: of robot.yaml. radius: joint → R of the sprocket, m. middle: joint → middle of its range, rad.
    """
    found = {}
    for index, joint in enumerate(log_set.joints):
        if joint not in radius:
            found[joint] = Design(radius=1.0)
            continue
        trials = [trial.trajectory for trial in log_set.fit]
        position = np.concatenate([t.position[:, index] for t in trials])
        error = np.concatenate([t.position_command[:, index] - t.position[:, index] for t in trials])
        found[joint] = joint_design(hydraulics, float(radius[joint]), float(position.mean() - middle[joint]), error)
        if log_set.control_mode not in (None, "position"):  # the valve then follows another gain
            found[joint] = replace(found[joint], gain=UNKNOWN, opening=UNKNOWN)
    return found


def joint_design(hydraulics: Mapping[str, Any], radius: float, offset: float, error: np.ndarray) -> Design:
    """`Design` of one joint; NaN where the file does not say, or says two areas.

    Args:
        hydraulics: of robot.yaml. radius: R, m. offset: of the posture from the middle of the range, rad.
        error: (T,) position errors that opened the valve, rad.
    """

    def known(path: str) -> float:
        node: Any = hydraulics
        for key in path.split("."):
            node = node.get(key, {}) if isinstance(node, Mapping) else {}
        return float(node) if isinstance(node, int | float) else UNKNOWN

    area = known("cylinder.area_a") if known("cylinder.area_a") == known("cylinder.area_b") else UNKNOWN
    half, moved = 0.5 * area * known("cylinder.stroke"), area * radius * offset
    null, gain = known("valve.null_opening"), known("firmware.position_pid.kp")
    opening = np.clip(gain * error, -1.0, 1.0)
    lag = 2.0 * known("valve.damping_ratio") / (2.0 * np.pi * known("valve.bandwidth_hz"))  # 2 ζ/ω, in slow motion
    return Design(
        radius=radius,
        area=area,
        bulk_modulus=known("fluid.bulk_modulus"),
        volume_a=known("cylinder.dead_volume_a") + half + moved,
        volume_b=known("cylinder.dead_volume_b") + half - moved,
        strand_stiffness=known("chain.stiffness"),
        tooth_stiffness=known("chain.tooth_stiffness"),
        leakage=known("cylinder.leakage"),
        pressure=known("supply.pressure") - known("supply.return_pressure"),
        valve_gain=known("valve.rated_flow") / np.sqrt(0.5 * known("valve.rated_drop")),
        null_opening=null,
        opening=float(np.mean(np.hypot(opening, null))),
        valve_delay=lag + known("valve.delay"),
        gain=gain,
    )
