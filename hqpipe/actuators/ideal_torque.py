"""Torque control as it is simulated without an actuator model."""

from __future__ import annotations

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.loops.actuator_step import PD


class IdealTorque(ActuatorModel):
    """τ = τ_des = kp (q_des − q) − kd q̇ with soft gains: the torque target is realised exactly and at once.

    On the machine the same PD law makes the torque target of the torque loop; the simulator takes that loop
    to be perfect up to the effort limit. Holds at any rate.
    """

    NAME = "ideal_torque"
    KIND = PD
    FIELDS = {
        "kp": ParameterField("N·m/rad"),
        "kd": ParameterField("N·m·s/rad"),
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True, certain=True),
    }
