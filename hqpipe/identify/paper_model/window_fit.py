"""Normal equations of the free-running fit of eq. (7), with exact forward sensitivities.

The unknowns of a window are the four joint-space gains and the torque at which the window starts:

    g = (k1 R², k2, k3 R², k4 R),   τ' = g0 e + (1 − g1) τ − g2 q̇ + g3 h(τ, e),   h = e · max(−τ sgn e, 0)

The sensitivity s = dτ/d(g, τ_start) runs beside the torque: s' = (1 − g1 + g3 dh/dτ) s + (e, −τ, −q̇, h, 0).
"""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
from hqpipe.actuators.loops.laws import impact

UNKNOWNS = 5  # four gains and the start torque


@njit(cache=True, nogil=True)
def advance(gains: np.ndarray, limit: float, torque: float, error: float, qd: float, s: np.ndarray) -> float:
    """One sample of torque and sensitivity; `s` (5,) is updated in place, the new torque returned."""
    h = impact(torque, error)
    slope = -abs(error) if torque * error < 0.0 else 0.0
    following = gains[0] * error + (1.0 - gains[1]) * torque - gains[2] * qd + gains[3] * h
    if abs(following) > limit:
        s[:] = 0.0
        return limit if following > 0.0 else -limit
    carry = 1.0 - gains[1] + gains[3] * slope
    s[0] = carry * s[0] + error
    s[1] = carry * s[1] - torque
    s[2] = carry * s[2] - qd
    s[3] = carry * s[3] + h
    s[4] = carry * s[4]
    return following


@njit(cache=True, nogil=True)
def add_residual(
    residual: float, weight: float, outlier: float, s: np.ndarray, hessian: np.ndarray, gradient: np.ndarray
) -> float:
    """Add one weighted residual to the lower triangle (5, 5) and the gradient (5,); returns its Huber loss."""
    size = abs(residual)
    loss = weight * residual * residual
    if size > outlier:
        loss = weight * outlier * (2.0 * size - outlier)
        weight *= outlier / size
    for i in range(UNKNOWNS):
        scaled = weight * s[i]
        gradient[i] += scaled * residual
        for m in range(i + 1):
            hessian[i, m] += scaled * s[m]
    return loss


@njit(cache=True, nogil=True)
def accumulate(
    gains: np.ndarray,
    limit: float,
    effort: np.ndarray,
    error: np.ndarray,
    qd: np.ndarray,
    windows: np.ndarray,
    start: np.ndarray,
    start_weight: float,
    outlier: float,
    hessian: np.ndarray,
    gradient: np.ndarray,
    cost: np.ndarray,
    residuals: np.ndarray,
    weight: np.ndarray,
) -> None:
    """Fill the Gauss-Newton normal equations of every window of one joint.

    Args:
        gains: (4,) joint-space gains.
        limit: effort limit, N·m.
        effort, error, qd: (T,) measured torque, q_des − q and joint velocity.
        windows: (W, 2) first and last sample of each window.
        start: (W,) torque at which each window starts, N·m.
        start_weight: weight of (start − measured)² against one later residual.
        outlier: residuals beyond this (N·m) count linearly (Huber's loss); may be infinite.
        hessian: (W, 5, 5), gradient: (W, 5), cost: (W,) – overwritten.
        residuals: (T,) simulated − measured torque, overwritten where a window predicts what was recorded.
        weight: (T,) of each sample of the torque; what was not recorded has 0 and counts for nothing, nor does a window that
            starts from it.
    """
    s = np.empty(UNKNOWNS)
    for w in range(windows.shape[0]):
        first, last = windows[w, 0], windows[w, 1]
        hessian[w] = 0.0
        gradient[w] = 0.0
        cost[w] = 0.0
        if weight[first] == 0.0:  # what starts from a torque that was not recorded says nothing
            hessian[w, 4, 4] = 1.0
            continue
        torque = start[w]
        offset = torque - effort[first]
        hessian[w, 4, 4] = start_weight
        gradient[w, 4] = start_weight * offset
        total = start_weight * offset * offset
        s[:] = 0.0
        s[4] = 1.0
        for k in range(first, last):
            torque = advance(gains, limit, torque, error[k], qd[k], s)
            if weight[k + 1] == 0.0:
                continue
            residual = torque - effort[k + 1]
            residuals[k + 1] = residual
            total += add_residual(residual, weight[k + 1], outlier, s, hessian[w], gradient[w])
        for i in range(UNKNOWNS):
            for m in range(i):
                hessian[w, m, i] = hessian[w, i, m]
        cost[w] = total


@njit(cache=True, nogil=True)
def one_step_moments(
    effort: np.ndarray, error: np.ndarray, qd: np.ndarray, weight: np.ndarray, windows: np.ndarray, span: int
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations of the least squares of τ(k+span) − τ(k) on the regressors summed over `span` samples.

    ``span=1`` is the paper's one-step regression. A longer span averages the torque noise that stands in the
    regressors and biases the one-step fit. Steps with a torque that was not recorded, of `weight` (T,) 0, are left out.

    Returns:
        (4, 4) and (4,) moments in the joint-space gains.
    """
    moments = np.zeros((4, 4))
    right = np.zeros(4)
    x = np.empty(4)
    for w in range(windows.shape[0]):
        for k in range(windows[w, 0], windows[w, 1] - span + 1, span):
            x[:] = 0.0
            recorded = weight[k + span] > 0.0
            for i in range(k, k + span):
                recorded &= weight[i] > 0.0
                x[0] += error[i]
                x[1] -= effort[i]
                x[2] -= qd[i]
                x[3] += impact(effort[i], error[i])
            if not recorded:
                continue
            rise = effort[k + span] - effort[k]
            for i in range(4):
                right[i] += x[i] * rise
                for m in range(4):
                    moments[i, m] += x[i] * x[m]
    return moments, right
