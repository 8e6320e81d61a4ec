"""Intervals of fitted parameters that hold for autocorrelated residuals.

The covariance is the sandwich H⁻¹ (Σ_b g_b g_bᵀ) H⁻¹ with the score g_b summed over blocks of half a second
(Liang & Zeger, Biometrika 73, 1986): a block is one observation, however many samples it holds. Few blocks
widen the interval through Student's t.

Noise is not all that is uncertain: an effect's formula simplifies what it stands for, in all joints alike. The intervals
that are stated (`stated`) hold that too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.effects import EFFECTS
from hqpipe.effects.effect import Parameter
from hqpipe.effects.layout import slots
from hqpipe.gap.bootstrap import BLOCK_S
from hqpipe.gap.joint_data import JointData
from hqpipe.gap.set_fit import SetFit
from hqpipe.kernels.augmented_fit import residual_windows

Z95 = 1.959964  # standard normal quantile at 97.5 %
SIMPLIFIED_ROWS = 0.05  # samples that the formulas of times simplify, beside a share of the value; measured likewise
STEP = 1e-4  # relative to the standard deviation of the parameter as a first guess gives it


@dataclass(frozen=True)
class Estimate:
    """One parameter in its own unit; `low`, `high`: 95 % interval; `deviation`: standard deviation."""

    value: float
    low: float
    high: float
    deviation: float


def estimates(data: JointData, fit: SetFit, effect: str) -> dict[str, Estimate]:
    """Parameters of one effect of a fitted set; those that lie at "absent" are left out."""
    from scipy.stats import t as student

    covariance, blocks = _covariance(data, fit)
    factor = float(student.ppf(0.975, max(blocks - len(fit.free), 1)))
    found = {}
    for column, parameter in zip(slots(effect), EFFECTS[effect].parameters, strict=True):
        if column not in fit.free:
            continue
        at = int(np.flatnonzero(fit.free == column)[0])
        value, deviation = float(fit.row[column]), float(np.sqrt(max(covariance[at, at], 0.0)))
        low, high = value - factor * deviation, value + factor * deviation
        if parameter.inverse:
            if value <= 0.0:
                continue
            low, high = 1.0 / max(high, 1e-300), 1.0 / max(low, 1e-3 * value)
            value, deviation = 1.0 / value, deviation / value**2
        if np.isfinite([value, low, high, deviation]).all():
            found[parameter.name] = Estimate(value, low, high, deviation)
    return found


def _covariance(data: JointData, fit: SetFit) -> tuple[np.ndarray, int]:
    """(n, n) covariance of the free columns, and the number of blocks; infinite where the free run would run away."""
    signals = data.fit.signals
    residual = residual_windows(fit.row, signals)
    guess = np.sqrt(np.maximum(np.diag(np.linalg.pinv(fit.hessian)), 0.0) * max(fit.loss, 1e-300))
    jacobian = np.empty((len(fit.free), *residual.shape))
    with np.errstate(over="ignore", invalid="ignore"):
        for slope, column, size in zip(jacobian, fit.free, guess, strict=True):
            moved = fit.row.copy()
            h = max(STEP * abs(fit.row[column]), 0.1 * size, 1e-12)
            moved[column] += h
            slope[:] = (residual_windows(moved, signals) - residual) / h
        information = np.einsum("nkw,mkw->nm", jacobian, jacobian)
    per_block = max(1, round(BLOCK_S / (signals.steps * data.row_dt)))
    edges = np.arange(0, residual.shape[1], per_block)
    blocks = len(edges)
    if not np.isfinite(information).all():
        return np.full_like(information, np.inf), blocks
    scores = np.einsum("nkw,kw->wn", jacobian, residual)
    sums = np.add.reduceat(scores, edges, axis=0)
    sums -= sums.mean(axis=0)
    bread = np.linalg.pinv(information)
    covariance = bread @ (sums.T @ sums) @ bread * blocks / max(blocks - 1, 1)
    silent = np.flatnonzero(np.diag(information) <= 0.0)  # the logs of this joint say nothing about these
    covariance[silent, silent] = fit.row[fit.free[silent]] ** 2
    return covariance, blocks


def pooled(parts: list[Estimate]) -> Estimate:
    """One number for several joints: weighted by precision, the interval widened if the joints disagree."""
    values = np.array([p.value for p in parts])
    least = 1e-6 * max(float(np.max(np.abs(values))), 1e-12)
    variance = np.array([max(p.deviation, least) for p in parts]) ** 2
    weight = 1.0 / variance
    value = float(weight @ values / weight.sum())
    spread = float(weight @ (values - value) ** 2 / max(len(parts) - 1, 1))
    deviation = float(np.sqrt(max(spread, 1.0) / weight.sum()))
    factors = np.array([(p.high - p.low) / max(2.0 * p.deviation, 1e-300) for p in parts])
    half = float(weight @ factors / weight.sum()) * deviation  # joints that know nothing do not widen it
    return Estimate(value, value - half, value + half, deviation)


def stated(part: Estimate, parameter: Parameter, dt: float) -> Estimate:
    """The estimate with the error of the effect's formula in its interval."""
    model = np.hypot(parameter.simplified * part.value, SIMPLIFIED_ROWS * dt if parameter.unit == "s" else 0.0)
    low, high = np.hypot(part.value - part.low, Z95 * model), np.hypot(part.high - part.value, Z95 * model)
    deviation = float(np.hypot(part.deviation, model))
    return Estimate(part.value, part.value - float(low), part.value + float(high), deviation)


def agree(parts: list[Estimate], tolerance: float = 0.25) -> bool:
    """Whether the joints could share one value: within `tolerance` of their median, or within their intervals."""
    middle = float(np.median([p.value for p in parts]))
    return all(abs(p.value - middle) <= tolerance * abs(middle) or p.low <= middle <= p.high for p in parts)
