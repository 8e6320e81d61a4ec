"""One sample of an actuator model, for one joint, one robot or a batch of robots.

Every model is a row of float64 parameters per joint and a kind. The state is the joint torque alone, so the
same compiled functions serve the simulator, the replay of a log and the fit.

kind       parameters of a joint                  torque after the sample
PD         kp, kd, limit                          kp (q_des − q) − kd q̇
HYDRAULIC  k1, k2, k3, k4, R, limit               eq. (7) of the paper

Both are clipped to ±limit, which may be infinite.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

PD: Final = 0
HYDRAULIC: Final = 1


@njit(cache=True, nogil=True, inline="always")
def impact(torque: float, error: float) -> float:
    """Δq · max(−τ sgn Δq, 0) of eq. (7), branch-free: nonzero only while torque and error are opposed."""
    return 0.5 * (error * abs(torque) - torque * abs(error))


@njit(cache=True, nogil=True, inline="always")
def clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


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


@njit(cache=True, nogil=True)
def step_joint(kind: int, p: np.ndarray, torque: float, q_des: float, q: float, qd: float) -> float:
    """Torque of one joint after one sample.

    Args:
        kind: PD or HYDRAULIC.
        p: (P,) parameters of the joint.
        torque, q_des, q, qd: N·m, rad, rad, rad/s at this sample.
    """
    if kind == HYDRAULIC:
        return hydraulic_step(p, torque, q_des, q, qd)
    return pd_step(p, q_des, q, qd)


@njit(cache=True, nogil=True)
def step_row(
    kind: int, parameters: np.ndarray, tau: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> None:
    """Advance the joints of one robot by one sample, in place.

    Args:
        kind: PD or HYDRAULIC.
        parameters: (J, P) float64.
        tau: (J,) torque, read and overwritten, N·m.
        q_des, q, qd: (J,) rad, rad, rad/s.
    """
    if kind == HYDRAULIC:
        for j in range(tau.shape[0]):
            tau[j] = hydraulic_step(parameters[j], tau[j], q_des[j], q[j], qd[j])
    else:
        for j in range(tau.shape[0]):
            tau[j] = pd_step(parameters[j], q_des[j], q[j], qd[j])


@njit(cache=True, nogil=True)
def step_batch(
    kind: int, parameters: np.ndarray, tau: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> None:
    """Advance N robots by one sample, in place and without allocation.

    Args:
        kind: PD or HYDRAULIC.
        parameters: (J, P) float64, the same for every robot.
        tau: (N, J) torque, read and overwritten, N·m.
        q_des, q, qd: (N, J) rad, rad, rad/s.
    """
    for n in range(tau.shape[0]):
        step_row(kind, parameters, tau[n], q_des[n], q[n], qd[n])
