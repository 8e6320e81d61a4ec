"""What an actuator does in the end when it is held still: for models whose equation does not tell."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators.base import ActuatorModel

ERROR_RAD = 0.01  # assumption: what a loaded joint of the reference robot stands off its target
SETTLED_S = 0.5  # assumption: long beside the lag of any actuator that could carry a walking robot


def settled_stiffness(model: ActuatorModel, position: np.ndarray, torque: np.ndarray, dt: float) -> np.ndarray:
    """(J,) torque per position error of a joint that is held for 0.5 s 0.01 rad off its target to either side, N·m/rad.

    Args:
        model: without an effort limit that it could meet. position: (J,) rad. torque: (J,) N·m, at the start. dt: s.
    """
    joints = len(model.joints)
    error = ERROR_RAD * np.concatenate([np.eye(joints), -np.eye(joints)])
    held = np.tile(np.asarray(position, dtype=np.float64), (2 * joints, 1))
    tau, memory = np.tile(np.asarray(torque, dtype=np.float64), (2 * joints, 1)), model.fresh_memory(2 * joints)
    for _ in range(round(SETTLED_S / dt)):
        model.step(tau, memory, held + error, held, np.zeros_like(held), dt)
    return (np.diagonal(tau[:joints]) - np.diagonal(tau[joints:])) / (2.0 * ERROR_RAD)
