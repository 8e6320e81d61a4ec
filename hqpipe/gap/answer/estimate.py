"""A number with its interval, of one joint or pooled over several."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Estimate:
    """One parameter in its own unit; `low`, `high`: 95 % interval; `deviation`: standard deviation."""

    value: float
    low: float
    high: float
    deviation: float


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


def agree(parts: list[Estimate], tolerance: float = 0.25) -> bool:
    """Whether the joints could share one value: within `tolerance` of their median, or within their intervals."""
    middle = float(np.median([p.value for p in parts]))
    return all(abs(p.value - middle) <= tolerance * abs(middle) or p.low <= middle <= p.high for p in parts)
