"""Intervals of fitted parameters that hold for autocorrelated residuals.

The covariance is the sandwich H⁻¹ (Σ_b g_b g_bᵀ) H⁻¹ with the score g_b summed over blocks of half a second
(Liang & Zeger, Biometrika 73, 1986): a block is one observation, however many samples it holds. Few blocks
widen the interval through Student's t.

Noise is not all that is uncertain: an effect's formula simplifies what it stands for, in all joints alike. The intervals
that are stated (`stated`) hold that too.

Where a joint is compared with an earlier record, all that is not fitted stands where that record put it. An error δ of the
record moves what is fitted by −H⁻¹ Jᵀ J_then δ (implicit function theorem), so that its covariance is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.effects import EFFECTS
from hqpipe.effects.effect import Parameter
from hqpipe.effects.layout import slot
from hqpipe.gap.bootstrap import BLOCK_S
from hqpipe.gap.changes import CANDIDATES, FACTORS, columns, leaders, multiplied, ratios
from hqpipe.gap.joint_data import JointData
from hqpipe.gap.set_fit import SetFit
from hqpipe.kernels.augmented_fit import multiply_physics, residual_windows
from hqpipe.kernels.augmented_signals import Signals

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


@dataclass(frozen=True, eq=False)
class Covariance:
    """Of the free numbers of a fit, (n, n) each; infinite where the free run would run away.

    Attributes:
        columns: (n,) the free columns. values: (n,) numbers; of changes since an earlier record their ratio.
        then: (n,) what they were in that record, of ratios 1; NaN without one.
        now: of the numbers. change: of what they differ by from the earlier record; the same without one.
        blocks: how many observations they rest on.
    """

    columns: np.ndarray
    values: np.ndarray
    then: np.ndarray
    now: np.ndarray
    change: np.ndarray
    blocks: int

    @property
    def factor(self) -> float:
        """Half of a 95 % interval over the standard deviation (Student's t)."""
        from scipy.stats import t as student

        return float(student.ppf(0.975, max(self.blocks - len(self.columns), 1)))


def estimates(data: JointData, fit: SetFit, effect: str) -> dict[str, Estimate]:
    """Parameters of one effect of a fitted set; those that lie at "absent" are left out."""
    if effect in FACTORS and data.then is not None and effect not in leaders(fit.effects, data.then.row):
        return {}
    covariance, found = covariance_of(data, fit), {}
    for at, parameter in _free_parameters(data, fit, effect, covariance):
        value, deviation = float(covariance.values[at]), float(np.sqrt(max(covariance.now[at, at], 0.0)))
        low, high = value - covariance.factor * deviation, value + covariance.factor * deviation
        if parameter.inverse:
            if value <= 0.0:
                continue
            low, high = parameter.told(high), parameter.told(max(low, 1e-3 * value))
            share = 0.5 if parameter.squared else 1.0
            value, deviation = parameter.told(value), share * parameter.told(value) * deviation / value
        if np.isfinite([value, low, high, deviation]).all():
            found[parameter.name] = Estimate(value, low, high, deviation)
    return found


def _free_parameters(data: JointData, fit: SetFit, effect: str, covariance: Covariance) -> list[tuple[int, Parameter]]:
    """Parameters of an effect that were fitted, with their places among the free numbers."""
    wanted = columns(effect)
    if effect in FACTORS and data.then is not None:
        wanted = [leaders(fit.effects, data.then.row)[effect]]
    pairs = zip(wanted, CANDIDATES[effect].parameters, strict=True)
    return [(int(np.flatnonzero(covariance.columns == c)[0]), p) for c, p in pairs if c in covariance.columns]


def certainty(data: JointData, fit: SetFit, effect: str, unchanged: dict[int, float] | None = None) -> float:
    """Standard errors by which an effect of a set differs from the earlier record, in the number that does so most.

    Args:
        unchanged: place among the free numbers → what stands for no change, where it is not what the record holds.
    """
    covariance = covariance_of(data, fit)
    if effect in FACTORS and effect not in leaders(fit.effects, data.then.row):
        return 0.0
    found = 0.0
    for at, parameter in _free_parameters(data, fit, effect, covariance):
        if parameter.counts:
            then = (unchanged or {}).get(at, float(covariance.then[at]))
            deviation = float(np.sqrt(max(covariance.change[at, at], 0.0)))
            found = max(found, abs(float(covariance.values[at]) - then) / max(deviation, 1e-300))
    return found


def covariance_of(data: JointData, fit: SetFit) -> Covariance:
    """Of the free numbers of a fit, with what the earlier record is uncertain by where there is one."""
    signals, then = data.fit.signals, data.then
    if then is None:
        fit = _without_idle(fit)
    residual = residual_windows(fit.row, signals)
    guess = np.sqrt(np.maximum(np.diag(np.linalg.pinv(fit.hessian)), 0.0) * max(fit.loss, 1e-300))
    ties = [group[group >= 0] for group in fit.tied] if fit.tied.shape[1:] != (0,) else []
    moves = [_moved(fit.row, c, ties[i] if ties else (), guess[i]) for i, c in enumerate(fit.free)]
    jacobian = _slopes(moves, residual, signals)
    values, record = fit.row[fit.free].astype(np.float64), np.full(len(fit.free), np.nan)
    if then is not None:
        record = then.row[fit.free].astype(np.float64)
        ratio = ratios(fit.row, then.row, fit.effects)
        for name, column in leaders(fit.effects, then.row).items():
            at = int(np.flatnonzero(fit.free == column)[0])
            jacobian[at] *= fit.row[column] / ratio[name]
            values[at], record[at] = ratio[name], 1.0
    now, blocks, bread = _sandwich(jacobian, residual, data, values)
    change = now
    if then is not None and len(then.columns) and np.isfinite(now).all():
        now, change = _with_then(data, fit, jacobian, residual, bread, now)
    return Covariance(fit.free, values, record, now, change, blocks)


def _without_idle(fit: SetFit) -> SetFit:
    """The fit less the shape parameters that lie at their lower bound and do nothing there: such a number is not free, and
    beside it others would seem not to be known."""
    idle = [
        column
        for name in fit.effects
        if name in EFFECTS
        for column, p in zip(columns(name), EFFECTS[name].parameters, strict=True)
        if not p.counts and p.lower == p.neutral == fit.row[column]
    ]
    kept = np.flatnonzero(~np.isin(fit.free, idle))
    hessian = fit.hessian[np.ix_(kept, kept)] if len(fit.hessian) else fit.hessian
    tied = fit.tied[kept] if len(fit.tied) else fit.tied
    return replace(fit, free=fit.free[kept], hessian=hessian, tied=tied)


def _moved(row: np.ndarray, column: int, tied: Sequence[int], size: float) -> tuple[np.ndarray, float]:
    """A row with one column, and what is tied to it, a little further, and how far."""
    moved = row.copy()
    h = max(STEP * abs(row[column]), 0.1 * size, 1e-12)
    if len(tied):
        multiply_physics(moved, np.asarray(tied), (row[column] + h) / row[column])
    else:
        moved[column] += h
    return moved, h


def _slopes(moves: list[tuple[np.ndarray, float]], residual: np.ndarray, signals: Signals) -> np.ndarray:
    """(n, steps, W) derivatives of the output by differences."""
    jacobian = np.empty((len(moves), *residual.shape))
    with np.errstate(over="ignore", invalid="ignore"):
        for slope, (moved, h) in zip(jacobian, moves, strict=True):
            slope[:] = (residual_windows(moved, signals) - residual) / h
    return jacobian


def _sandwich(
    jacobian: np.ndarray, residual: np.ndarray, data: JointData, values: np.ndarray
) -> tuple[np.ndarray, int, np.ndarray]:
    """(n, n) covariance, the number of blocks, and H⁻¹."""
    with np.errstate(over="ignore", invalid="ignore"):
        information = np.einsum("nkw,mkw->nm", jacobian, jacobian)
    per_block = max(1, round(BLOCK_S / (data.fit.signals.steps * data.row_dt)))
    edges = np.arange(0, residual.shape[1], per_block)
    blocks = len(edges)
    if not np.isfinite(information).all():
        return np.full_like(information, np.inf), blocks, information
    scores = np.einsum("nkw,kw->wn", jacobian, residual)
    sums = np.add.reduceat(scores, edges, axis=0)
    sums -= sums.mean(axis=0)
    bread = np.linalg.pinv(information)
    covariance = bread @ (sums.T @ sums) @ bread * blocks / max(blocks - 1, 1)
    silent = np.flatnonzero(np.diag(information) <= 0.0)  # the logs of this joint say nothing about these
    covariance[silent, silent] = values[silent] ** 2
    return covariance, blocks, bread


def _with_then(
    data: JointData, fit: SetFit, jacobian: np.ndarray, residual: np.ndarray, bread: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (n, n) of the numbers and of their differences, with that of the earlier record in them."""
    then, led = data.then, [slot("base", name) for name in ("k1", "k2", "k3", "k4")]
    sizes = np.sqrt(np.maximum(np.diag(then.covariance), 0.0))
    changed, moves = ratios(fit.row, then.row, fit.effects), []
    for column, size in zip(then.columns, sizes, strict=True):
        moved, h = _moved(then.row, column, (), size)
        for name, ratio in changed.items():
            moved = multiplied(moved, name, ratio)
        shifted = fit.row.copy()
        if column in led:
            shifted[led] = moved[led]
        else:
            shifted[column] += h
        moves.append((shifted, h))
    slopes = _slopes(moves, residual, data.fit.signals)
    passed = -bread @ np.einsum("nkw,mkw->nm", jacobian, slopes)
    passed[~np.isfinite(passed)] = 0.0
    apart = passed.copy()
    for i, column in enumerate(fit.free):
        if column not in led:
            passed[:, then.columns == column] = 0.0  # it is fitted anew, wherever it was
            apart[:, then.columns == column] = 0.0
            apart[i, then.columns == column] = -1.0
    return own + passed @ then.covariance @ passed.T, own + apart @ then.covariance @ apart.T


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
