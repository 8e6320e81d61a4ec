"""Position control as it is simulated without an actuator model."""

from __future__ import annotations

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.loops.actuator_step import PD


class StiffPD(ActuatorModel):
    """τ = kp (q_des − q) − kd q̇ with high gains, at once and clipped to the effort limit.

    The stand-in for position control that the paper trains against when it has no actuator model. Holds at
    any rate.
    """

    NAME = "stiff_pd"
    KIND = PD
    FIELDS = {
        "kp": ParameterField("N·m/rad"),
        "kd": ParameterField("N·m·s/rad"),
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True, certain=True),
    }
