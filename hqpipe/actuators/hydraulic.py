"""The paper's analytical model of a position-controlled hydraulic joint."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField, end_to_end
from hqpipe.actuators.loops.actuator_step import HYDRAULIC
from hqpipe.actuators.loops.batch_step import hydraulic_batch, hydraulic_columns


class Hydraulic(ActuatorModel):
    """Eq. (7) of the paper, clipped to the effort limit:

        τ_next = k1 R² Δq + (1 − k2) τ − k3 R² q̇ + k4 R Δq · max(−τ sgn Δq, 0),   Δq = q_des − q

    k1 is the force gained per metre of position error in one sample, k2 the share of the force that leaks
    away, k3 the resistance to motion, and k4 the correction while an impact drives the torque against the
    error. All four are per sample, hence bound to `dt`. For a joint without a known sprocket R is 1.
    """

    NAME = "hydraulic"
    KIND = HYDRAULIC
    DT_BOUND = True
    FIELDS = {
        "k1": ParameterField("N/m"),
        "k2": ParameterField("1", upper=1.0),
        "k3": ParameterField("N·s/m"),
        "k4": ParameterField("1/m"),
        "sprocket_radius": ParameterField("m", lower=1e-6, certain=True),
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True, certain=True),
    }

    @cached_property
    def _columns(self) -> np.ndarray:
        return hydraulic_columns(self.parameters)

    def _advance(self, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
        if flat := end_to_end(tau, q_des, q, qd):
            hydraulic_batch(self._columns, *flat)
        else:
            super()._advance(tau, memory, q_des, q, qd)
