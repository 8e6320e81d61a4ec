"""Levenberg-Marquardt fit of an augmented actuator to windows of a log, one compiled call per fit.

Residuals are Huber-weighted. The Jacobian is by forward differences: every effect is a scalar function with
kinks (dead zones, limits), whose one-sided slopes are what the step needs.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.effects import EFFECTS, effect
from hqpipe.effects.layout import FIELDS
from hqpipe.kernels.augmented_columns import (
    ALL,
    BEHIND,
    COMMAND,
    COMPLIANCE,
    COMPRESSION,
    CORE,
    COULOMB,
    COULOMB_ASYMMETRY,
    FOLLOW,
    K1,
    K2,
    K3,
    K4,
    KI,
    LEAK_DRIFT,
    LOAD,
    ORIFICE,
    SLIDE,
    SLOPE,
    STATIC,
    SUPPLY,
    VISCOUS,
)
from hqpipe.kernels.augmented_signals import Signals, Work, make_work
from hqpipe.kernels.augmented_windows import simulate

MOST_LEAKED = 1.0 - 1e-9  # of the torque in a sample
STEP = 1e-4  # of a parameter's scale: above rounding, below curvature
_DRIVEN = COMMAND | FOLLOW
_INPUTS = {
    effect.CORE: CORE,
    effect.FRICTION: FOLLOW,
    effect.SLIDING: SLIDE | FOLLOW,
    effect.COMMAND_SIDE: _DRIVEN,
    effect.SUPPLY: SUPPLY | _DRIVEN,
    effect.ALL_INPUTS: ALL,
}
_BY_STAGE = {"clock": _DRIVEN, "command": _DRIVEN, "core": CORE, "output": CORE}


def _inputs(owner: str, name: str) -> int:
    if owner not in EFFECTS:
        return CORE
    anew = next(p.anew for p in EFFECTS[owner].parameters if p.name == name)
    return _INPUTS[anew] if anew else _BY_STAGE[EFFECTS[owner].stage]


CHANGES = np.array([_inputs(*field) for field in FIELDS])
"""(WIDTH,) what a change of each column makes necessary, see `simulate`."""
GRIPS = (COULOMB, COULOMB_ASYMMETRY, STATIC, LOAD)  # slopes leave out what they change before a window starts
HOLDS = (
    K1,
    K2,
    K3,
    K4,
    LEAK_DRIFT,
    ORIFICE,
    SLOPE,
    COMPRESSION,
    COMPLIANCE,
)  # columns of the core that tell what an integrator holds


@njit(cache=True, nogil=True)
def _cost(out: np.ndarray, target: np.ndarray, outlier: float, residual: np.ndarray, weight: np.ndarray) -> float:
    """Huber loss; fills residual and square root of the weight, (steps · W,) each. A target of NaN counts for nothing."""
    total, i = 0.0, 0
    for k in range(out.shape[0]):
        for w in range(out.shape[1]):
            r = 0.0 if np.isnan(target[k + 1, w]) else out[k, w] - target[k + 1, w]
            size = abs(r)
            residual[i] = r
            if size > outlier:
                weight[i] = np.sqrt(outlier / size)
                total += outlier * (2.0 * size - outlier)
            else:
                weight[i] = 0.0 if np.isnan(target[k + 1, w]) else 1.0
                total += r * r
            i += 1
    return total


@njit(cache=True, nogil=True)
def multiply_physics(row: np.ndarray, tied: np.ndarray, factor: float) -> None:
    """Multiply what some of k1 … k4 stand for in continuous time, in place.

    Leakage makes the torque decay by exp(−x) in a sample, and what comes in during it decays with it: k2 = 1 − exp(−x), and
    k1, k3 and k4 are x-fold smaller than their rates by (1 − exp(−x))/x = k2/x. So more leakage lowers k1, k3 and k4 too.

    Args:
        row: (WIDTH,). tied: (T,) columns among k1 … k4, filled up with −1.
    """
    before = row[K2]
    decay = -np.log1p(-min(before, MOST_LEAKED))
    within = before / decay if decay > 0.0 else 1.0
    for column in tied:
        if column == K2:
            decay *= factor
        elif column >= 0:
            row[column] *= factor
    row[K2] = -np.expm1(-decay)
    left = (row[K2] / decay if decay > 0.0 else 1.0) / within
    row[K1] *= left
    row[K3] *= left
    row[K4] *= left


@njit(cache=True, nogil=True)
def _move(moved: np.ndarray, p: np.ndarray, at: int, value: float, tied: np.ndarray) -> None:
    """Bring column `at` from `p` to `value`; where it is tied, multiply the physics of the tied ones by value/p[at]."""
    if tied.shape[0] == 0 or tied[0] < 0:
        moved[at] = value
    else:
        multiply_physics(moved, tied, value / p[at])


@njit(cache=True, nogil=True)
def _jacobian(
    p: np.ndarray,
    s: Signals,
    work: Work,
    base: np.ndarray,
    trial: np.ndarray,
    free: np.ndarray,
    scale: np.ndarray,
    upper: np.ndarray,
    tied: np.ndarray,
    changes: np.ndarray,
    weight: np.ndarray,
    jacobian: np.ndarray,
) -> None:
    """Weighted derivatives of the output, (n, steps · W); `work` holds what `simulate` left there for `p`."""
    moved = p.copy()
    stale = CORE
    lag, relaxed = _lag_row(p, free), np.zeros(free.shape[0])
    for i in range(free.shape[0]):
        at = free[i]
        h = STEP * scale[i]
        if p[at] + h > upper[i]:
            h = -h
        _move(moved, p, at, p[at] + h, tied[i])
        inputs = changes[at] if at not in GRIPS else CORE
        if p[KI] != 0.0 and at in HOLDS:
            inputs |= _DRIVEN  # what the integrator holds at the start hangs on the core
        if p[BEHIND] != 0.0 and at != BEHIND and (moved[VISCOUS] != p[VISCOUS] or moved[K3] != p[K3]):
            if lag < 0:
                inputs = ALL
            else:  # the lag is kept as it was, and what its change does is taken from the lag's own slope
                longer = moved[VISCOUS] / p[VISCOUS] * p[K3] / moved[K3]
                moved[BEHIND] = p[BEHIND] / longer
                relaxed[i] = p[BEHIND] * (longer - 1.0) / h
        simulate(moved, s, work, trial, inputs | stale)
        stale = inputs
        moved[:] = p
        _slope(jacobian[i], trial, base, 1.0 / h, weight)
    for i in range(free.shape[0]):
        if relaxed[i] != 0.0:
            jacobian[i] += relaxed[i] * jacobian[lag]


@njit(cache=True, nogil=True)
def _slope(row: np.ndarray, moved: np.ndarray, base: np.ndarray, per_step: float, weight: np.ndarray) -> None:
    """Fill a row of the Jacobian; row by row, so that the compiler can do several samples at once."""
    windows = base.shape[1]
    for k in range(base.shape[0]):
        at = k * windows
        for w in range(windows):
            row[at + w] = (moved[k, w] - base[k, w]) * per_step * weight[at + w]


@njit(cache=True, nogil=True)
def _lag_row(p: np.ndarray, free: np.ndarray) -> int:
    """Index of the free column that alone moves the lag of a rubbing piston; −1 where none can."""
    if p[VISCOUS] <= 0.0 or p[K3] <= 0.0:
        return -1
    for i in range(free.shape[0]):
        if free[i] == BEHIND:
            return i
    return -1


@njit(cache=True, nogil=True)
def _damped_step(
    hessian: np.ndarray, gradient: np.ndarray, value: np.ndarray, lower: np.ndarray, upper: np.ndarray, damping: float
) -> np.ndarray:
    """Step of the free parameters; one that its gradient presses against a bound stays there."""
    n = gradient.shape[0]
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        pressed = (value[i] <= lower[i] and gradient[i] > 0.0) or (value[i] >= upper[i] and gradient[i] < 0.0)
        if pressed or hessian[i, i] <= 0.0:
            matrix[i, i] = 1.0
            continue
        right[i] = -gradient[i]
        for m in range(n):
            matrix[i, m] = hessian[i, m]
    for i in range(n):
        if right[i] == 0.0 and matrix[i, i] == 1.0:
            matrix[:, i] = 0.0
            matrix[i, :] = 0.0
            matrix[i, i] = 1.0
        else:
            matrix[i, i] *= 1.0 + damping
    unit = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    for i in range(n):
        right[i] /= unit[i]
        for m in range(n):
            matrix[i, m] /= unit[i] * unit[m]
        matrix[i, i] += 1e-12
    return np.linalg.solve(matrix, right) / unit


@njit(cache=True, nogil=True)
def fit_windows(
    start: np.ndarray,
    s: Signals,
    free: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    scale: np.ndarray,
    tied: np.ndarray,
    changes: np.ndarray,
    outlier: float,
    iterations: int,
    tolerance: float,
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Fit the free columns of a row.

    Args:
        start: (WIDTH,) row to begin with.
        s: data.
        free: (n,) columns to fit; lower, upper, scale: (n,) bounds and sizes.
        tied: (n, T) columns of the base model whose physics grow by one factor with a free one, itself among them, filled up
            with −1 (see `multiply_physics`); a row of −1, or T = 0, for a column that moves alone. Such a free column must
            not be 0, and its steps are steps of that factor times its value.
        changes: (WIDTH,) `CHANGES`.
        outlier: residuals beyond count linearly, in the unit of the output.
        iterations: at most.
        tolerance: stop when the loss falls by less than this share.

    Returns:
        The row, the Huber loss per sample, the Gauss-Newton matrix JᵀJ (n, n) where the last step began, zero if the free run
        is about to run away there, and the residuals (steps, W).
    """
    work = make_work(s)
    out, trial = np.empty((s.steps, s.first.shape[0])), np.empty((s.steps, s.first.shape[0]))
    size, n = out.size, free.shape[0]
    residual, weight, following = np.empty(size), np.empty(size), np.empty(size)
    jacobian = np.empty((n, size))
    p = start.copy()
    inputs = CORE
    for i in range(n):
        inputs |= changes[free[i]]  # what is tied is of the core, like the column that it is tied to
    simulate(p, s, work, out, ALL)
    cost = _cost(out, s.target, outlier, residual, weight)
    damping, hessian = 1e-3, np.zeros((n, n))
    for _ in range(iterations):
        _jacobian(p, s, work, out, trial, free, scale, upper, tied, changes, weight, jacobian)
        hessian = jacobian @ jacobian.T
        gradient = jacobian @ (weight * residual)
        if not np.isfinite(hessian).all() or not np.isfinite(gradient).all():
            hessian[:] = 0.0  # a runaway start; its loss says so
            break
        fell = 0.0
        for _ in range(8):
            step = _damped_step(hessian, gradient, p[free], lower, upper, damping)
            moved = p.copy()
            for i in range(n):
                _move(moved, p, free[i], min(max(p[free[i]] + step[i], lower[i]), upper[i]), tied[i])
            simulate(moved, s, work, trial, inputs)
            next_cost = _cost(trial, s.target, outlier, following, weight)
            if next_cost < cost:
                fell = cost - next_cost
                p, cost = moved, next_cost
                out, trial = trial, out
                residual, following = following, residual
                damping = max(0.2 * damping, 1e-9)
                break
            damping *= 8.0
        if fell <= tolerance * cost:
            break
    return p, cost / size, hessian, residual.reshape(out.shape)


@njit(cache=True, nogil=True)
def residual_windows(p: np.ndarray, s: Signals) -> np.ndarray:
    """(steps, W) predicted − logged output of every window; 0 where the target is NaN."""
    out = np.empty((s.steps, s.first.shape[0]))
    errors_of_windows(p, s, make_work(s), out, ALL)
    return out


@njit(cache=True, nogil=True)
def errors_of_windows(p: np.ndarray, s: Signals, work: Work, out: np.ndarray, inputs: int) -> None:
    """Fill `out` (steps, W) with what `residual_windows` gives; inputs: see `simulate`."""
    simulate(p, s, work, out, inputs)
    for k in range(out.shape[0]):
        for w in range(out.shape[1]):
            out[k, w] = 0.0 if np.isnan(s.target[k + 1, w]) else out[k, w] - s.target[k + 1, w]
