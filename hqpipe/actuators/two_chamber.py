"""A physical rival of the paper's model: oil in two chambers behind a servo valve."""

from __future__ import annotations

from dataclasses import replace
from typing import Self

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.loops.actuator_step import CHAMBERS
from hqpipe.actuators.loops.chamber_step import MEMORY


class TwoChamber(ActuatorModel):
    """Pressures of two chambers, turbulent flow through four lands, a valve that lags, leakage, seal friction.

    Equations: `hqpipe.actuators.loops.chamber_step`, after Merritt, *Hydraulic Control Systems*, Wiley 1967, ch. 3, 5 and 6,
    and Jelali and Kroll, *Hydraulic Servo-systems*, Springer 2003, ch. 4. In shares of the supply pressure a torque log
    fixes these combinations of area A, sprocket radius R, supply less return P, bulk modulus β, mean chamber volume V,
    orifice constant k_v (m³/s per √Pa at full stroke) and controller gain k_p (stroke per rad), and no more of them:

        full_torque T = A R P          stiffness K = 2 β A² R² / V          flow_gain G = k_p k_v √(P/2) / (A R)
        leakage C = c P / (A R)        volume_slope ε = A R / V             valve_lag, null_opening, friction as such

    β and V, or k_p and k_v, never stand apart. T itself shows only in what the torque does to the flow, so small torques
    (below a quarter of T) fix K and G but leave T and C to their ratio.
    """

    NAME = "two_chamber"
    KIND = CHAMBERS
    MEMORY = MEMORY
    DT_BOUND = True
    FIELDS = {
        "full_torque": ParameterField("N·m", lower=1e-6),
        "stiffness": ParameterField("N·m/rad"),
        "flow_gain": ParameterField("1/s", lower=1e-9),
        "valve_lag": ParameterField("s", lower=1e-6),
        "leakage": ParameterField("rad/s"),
        "null_opening": ParameterField("rad"),
        "volume_slope": ParameterField("1/rad"),
        "coulomb_friction": ParameterField("N·m"),
        "viscous_friction": ParameterField("N·m·s/rad"),
        "speed_limit": ParameterField("rad/s", lower=1e-9, may_be_infinite=True, certain=True),
        "middle": ParameterField("rad", lower=-1e6, certain=True),
        "sample_time": ParameterField("s", lower=1e-9, certain=True),
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True, certain=True),
    }

    def at_rate(self, dt: float) -> Self:
        """The same machine stepped every `dt` seconds: physics knows no sample time."""
        table = np.array(self.parameters)
        table[:, list(self.FIELDS).index("sample_time")] = dt
        return replace(self, parameters=table, dt=dt)
