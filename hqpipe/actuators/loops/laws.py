"""The laws of the plain actuator models, as scalar functions that every loop inlines."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.bases.hydraulic import clip, impact


@njit(cache=True, nogil=True, inline="always")
def pd_step(p: np.ndarray, q_des: float, q: float, qd: float) -> float:
    """Torque of a PD law; `p` is kp, kd, limit (N·m/rad, N·m·s/rad, N·m)."""
    return clip(p[0] * (q_des - q) - p[1] * qd, p[2])


@njit(cache=True, nogil=True, inline="always")
def hydraulic_step(p: np.ndarray, torque: float, q_des: float, q: float, qd: float) -> float:
    """Torque after one sample, eq. (7) of the paper; `p` is k1, k2, k3, k4, R, limit."""
    radius = p[4]
    error = q_des - q
    following = radius * (radius * (p[0] * error - p[2] * qd) + p[3] * impact(torque, error)) + (1.0 - p[1]) * torque
    return clip(following, p[5])
