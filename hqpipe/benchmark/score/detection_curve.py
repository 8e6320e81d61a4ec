"""How often effects are named against their size: a logistic curve, and the size at which nine in ten are named."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, log_expit

from hqpipe.benchmark.score.share import wilson

NEEDED = 0.9  # the aim's nine times in ten
LEAST_CASES = 20  # assumption: with fewer cases a curve of two parameters says nothing
LEAST_EFFECT_CASES = 12  # assumption: likewise, where single effects are only looked at
REPLICATES = 1000  # of the bootstrap: the ends of a 95 % interval rest on 25 each
UNDEFINED = 0.05  # share of replicates without a ratio beyond which there is no interval
SEED = 20  # of the bootstrap; any number
_MOST_STEPS, _MOST_HALVES, _CLOSE = 100, 40, 1e-12  # of Newton's method, which needs about ten; in log-likelihood
_LARGEST = 700.0  # exp of it is still a number


@dataclass(frozen=True)
class Curve:
    """P(named) = 1 / (1 + exp(−slope · ln(size / middle))).

    Attributes:
        cases, named: how many. low, high: smallest and largest size.
        slope, middle: None where there is no likeliest curve.
        limit: size at which nine in ten are named; None where the sizes do not show it, for `reason`.
        raw: `limit` without regard to the sizes: 0 where all are named, infinite where none is, the middle of the
            bracket where named and unnamed sizes do not overlap; NaN where there is nothing to say.
        log_likelihood: of the curve, None without one.
    """

    cases: int
    named: int
    low: float | None
    high: float | None
    slope: float | None = None
    middle: float | None = None
    limit: float | None = None
    reason: str = ""
    raw: float = math.nan
    log_likelihood: float | None = None


def fit_curve(sizes: np.ndarray, named: np.ndarray, least_cases: int = LEAST_CASES) -> Curve:
    """The likeliest logistic curve over the logarithm of the size, where there is one.

    Args:
        sizes: (N,) above zero. named: (N,) bool. least_cases: with fewer there is no curve.
    """
    sizes, named = np.asarray(sizes, dtype=float), np.asarray(named, dtype=bool)
    count, right = len(sizes), int(named.sum())
    seen = {"cases": count, "named": right}
    seen |= {"low": float(sizes.min()) if count else None, "high": float(sizes.max()) if count else None}
    if count < least_cases:
        return Curve(**seen, reason=f"{count} cases, at least {least_cases} are needed")
    if right == count:
        return Curve(**seen, raw=0.0, reason=f"named at every size: the limit lies below {sizes.min():.3g}")
    if right == 0:
        return Curve(**seen, raw=math.inf, reason=f"named at no size: the limit lies above {sizes.max():.3g}")
    hidden, shown = float(sizes[~named].max()), float(sizes[named].min())
    if hidden <= shown:
        reason = f"all above {shown:.3g} are named and none below {hidden:.3g}: the limit lies between"
        return Curve(**seen, raw=math.sqrt(hidden * shown), reason=reason)
    once, x = np.ones((1, count)), np.log(sizes)
    raw = float(_raw_limits(sizes, named, once)[0])
    if math.isnan(raw):
        return Curve(**seen, reason="larger effects are not named more often")
    offset, slope = (float(value) for value in _likeliest(x, named, once)[0])
    middle = math.exp(float(np.clip(-offset / slope, -_LARGEST, _LARGEST)))
    log_likelihood = float(log_expit(np.where(named, 1.0, -1.0) * (offset + slope * x)).sum())
    reason = _objection(raw, sizes, named)
    limit = None if reason else raw
    return Curve(**seen, slope=slope, middle=middle, limit=limit, reason=reason, raw=raw, log_likelihood=log_likelihood)


def _objection(raw: float, sizes: np.ndarray, named: np.ndarray) -> str:
    """Why the curve's limit is not one that the sizes show; empty if it is."""
    if raw > sizes.max():
        return f"nine in ten are named at no size: the limit lies above {sizes.max():.3g}"
    if raw < sizes.min():
        return f"nine in ten are named at every size: the limit lies below {sizes.min():.3g}"
    above = named[sizes >= raw]
    if wilson(int(above.sum()), len(above))[1] < NEEDED:
        return (
            f"above the curve's limit of {raw:.3g} only {above.mean():.0%} are named: some effects are named at no size"
        )
    return ""


def _likeliest(x: np.ndarray, named: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(R, 2) offset and slope over x at the maximum of each likelihood, by Newton's method on all of them at once.

    There is one maximum where named and unnamed sizes overlap (Albert & Anderson, Biometrika 71, 1984); steps are
    halved until they climb.

    Args:
        x: (N,) logarithms of the sizes. named: (N,) bool. weights: (R, N) how often each case counts.
    """
    mean, spread, sign = x.mean(), x.std(), np.where(named, 1.0, -1.0)
    z = (x - mean) / spread
    share = weights @ named / weights.sum(axis=1)
    p = np.column_stack([np.log(share / (1.0 - share)), np.zeros(len(weights))])
    best = _likelihood(p, z, sign, weights)
    for _ in range(_MOST_STEPS):
        step, rise = _newton_step(p, z, named, weights)
        going = rise > _CLOSE
        if not going.any():
            break
        part = np.where(going, 1.0, 0.0)
        for _ in range(_MOST_HALVES):
            reached = _likelihood(p + part[:, None] * step, z, sign, weights)
            if not (falls := reached < best).any():
                break
            part[falls] *= 0.5
        climbs = reached >= best
        p, best = np.where(climbs[:, None], p + part[:, None] * step, p), np.where(climbs, reached, best)
    slope = p[:, 1] / spread
    return np.column_stack([p[:, 0] - slope * mean, slope])


def _likelihood(p: np.ndarray, z: np.ndarray, sign: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(R,) logarithms; p: (R, 2), z: (N,), sign: (N,) 1 for named and −1, weights: (R, N)."""
    return (weights * log_expit(sign * (p[:, :1] + p[:, 1:] * z))).sum(axis=1)


def _newton_step(p: np.ndarray, z: np.ndarray, named: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, 2) step to the maximum of the parabola that touches, and (R,) the slope along it."""
    chance = expit(p[:, :1] + p[:, 1:] * z)
    pull, bend = weights * (named - chance), weights * chance * (1.0 - chance)
    g0, g1 = pull.sum(axis=1), pull @ z
    h0, h1, h2 = bend.sum(axis=1), bend @ z, bend @ z**2
    area = h0 * h2 - h1**2
    with np.errstate(invalid="ignore", divide="ignore"):
        step = np.column_stack([(h2 * g0 - h1 * g1) / area, (h0 * g1 - h1 * g0) / area])
    step = np.where(np.isfinite(step), step, 0.0)
    return step, g0 * step[:, 0] + g1 * step[:, 1]


def _raw_limits(sizes: np.ndarray, named: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(R,) `Curve.raw` of the cases counted by each row of `weights`, (R, N)."""
    inside, x = weights > 0, np.log(sizes)
    hidden = np.where(inside & ~named, x, -np.inf).max(axis=1)
    shown = np.where(inside & named, x, np.inf).min(axis=1)
    highest = np.where(inside & named, x, -np.inf).max(axis=1)
    lowest = np.where(inside & ~named, x, np.inf).min(axis=1)
    raw = np.full(len(weights), np.nan)
    raw[np.isinf(hidden)], raw[np.isinf(shown)] = 0.0, np.inf
    mixed = np.isfinite(hidden) & np.isfinite(shown)
    apart = mixed & (hidden <= shown)
    raw[apart] = np.exp(0.5 * (hidden[apart] + shown[apart]))
    rows = np.flatnonzero(mixed & ~apart & (highest > lowest))
    if len(rows):
        offset, slope = _likeliest(x, named, weights[rows]).T
        rises = slope > 0.0
        exponent = (math.log(NEEDED / (1.0 - NEEDED)) - offset[rises]) / slope[rises]
        raw[rows[rises]] = np.exp(np.clip(exponent, -_LARGEST, _LARGEST))
    return raw


@dataclass(frozen=True)
class Comparison:
    """The limit of one method over that of another on the same cases.

    Attributes:
        ratio: None where one of the limits is, for `reason`.
        least: a lower bound of the ratio where the first limit lies above all sizes; else None.
        ci95: of the ratio; [low, None] has no upper end. None where too few replicates have a ratio.
        limits95: likewise of the two limits, for the first and the second method.
    """

    ratio: float | None
    least: float | None
    reason: str
    ci95: tuple[float, float | None] | None
    limits95: tuple[tuple[float, float | None] | None, tuple[float, float | None] | None]


def compare(sizes: np.ndarray, named: np.ndarray, other: np.ndarray, least_cases: int = LEAST_CASES) -> Comparison:
    """Ratio of two limits with a percentile interval of the paired bootstrap over cases (Efron, SIAM CBMS 38, 1982).

    Args:
        sizes: (N,) above zero. named, other: (N,) bool of the two methods. least_cases: with fewer nothing is said.
    """
    sizes, named, other = np.asarray(sizes, dtype=float), np.asarray(named, bool), np.asarray(other, bool)
    first, second = fit_curve(sizes, named, least_cases), fit_curve(sizes, other, least_cases)
    if len(sizes) < least_cases:
        return Comparison(None, None, first.reason, None, (None, None))
    if first.limit is None or second.limit is None:
        least = first.high / second.limit if second.limit is not None and first.raw > first.high else None
        said = [f"{name}: {c.reason}" for name, c in (("diagnosis", first), ("oracle", second)) if c.limit is None]
        return Comparison(None, least, "; ".join(said), None, (None, None))
    drawn = np.random.default_rng(SEED).multinomial(len(sizes), np.full(len(sizes), 1.0 / len(sizes)), REPLICATES)
    raw = np.column_stack([_raw_limits(sizes, outcome, drawn) for outcome in (named, other)])
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = raw[:, 0] / raw[:, 1]
    ends = tuple(_interval(raw[:, i]) for i in (0, 1))
    return Comparison(first.limit / second.limit, None, "", _interval(ratios), ends)


def _interval(values: np.ndarray) -> tuple[float, float | None] | None:
    """95 % of the values, some of which may be infinite or not a number."""
    known = values[~np.isnan(values)]
    if len(known) < (1.0 - UNDEFINED) * len(values):
        return None
    low, high = np.quantile(known, (0.025, 0.975), method="inverted_cdf")
    return None if np.isinf(low) else (float(low), float(high) if np.isfinite(high) else None)
