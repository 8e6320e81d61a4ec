"""Streams with clocks of their own on one clock."""

from __future__ import annotations

import numpy as np

from hqpipe.logs.imports.clock import GAP_SAMPLES

_LEAST_CORRELATION = 0.9  # assumption: below it two signals are not the same thing measured twice
_AS_GOOD = 0.02  # assumption: correlations this close do not tell two lags apart; the shorter one is meant
_LONGEST_LAG_S = 0.5  # assumption: recorders that buffer for longer do not stamp at all
_LEAST_POINTS = 200  # samples that a lag is estimated from


def is_held(column: str) -> bool:
    """Whether a column keeps its value until the next one is sent, as commands and contacts do."""
    return column.endswith(("_command", "/contact")) or column.startswith("command/")


def overlap(clocks: list[np.ndarray]) -> tuple[float, float]:
    """First and last time, s, at which every clock runs; the last one is before the first if they have none in common."""
    return max(time[0] for time in clocks), min(time[-1] for time in clocks)


def onto(clock: np.ndarray, time: np.ndarray, values: np.ndarray, *, held: bool) -> np.ndarray:
    """Values at the times of another clock; never across a gap.

    Args:
        clock: (N,) s, where values are wanted. time: (T,) s, strictly increasing. values: (T,), NaN where missing.
        held: keep the value last sent; else interpolate on a straight line.

    Returns:
        (N,), NaN where the samples around lie more than `GAP_SAMPLES` median steps apart, and outside of `time`.
    """
    present = np.isfinite(values)
    if present.sum() < 2:
        return np.full(len(clock), np.nan)
    longest = GAP_SAMPLES * float(np.median(np.diff(time)))
    at, samples = time[present], values[present]
    before = np.searchsorted(at, clock, side="right") - 1
    inside = (before >= 0) & (clock <= at[-1])
    before = np.clip(before, 0, len(at) - 1)
    after = np.minimum(before + 1, len(at) - 1)
    found = samples[before] if held else np.interp(clock, at, samples)
    near = (at[after] - at[before] <= longest) | (clock == at[before])
    return np.where(inside & near, found, np.nan)


def lag_of_velocity(time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> float | None:
    """How much later a recorded velocity is than the derivative of the position, s; None where that cannot be told.

    The two are one quantity measured twice, so that a lag is one of the recording, not of the machine.

    Args:
        time, position, velocity: (T,), on one clock, NaN where missing.
    """
    dt = float(np.median(np.diff(time)))
    present = np.isfinite(position) & np.isfinite(velocity)
    if present.sum() < _LEAST_POINTS:
        return None
    uniform = np.arange(time[0], time[-1], dt)
    x, y = (np.interp(uniform, time[present], signal[present]) for signal in (position, velocity))
    x = np.gradient(x, dt)
    x, y = x - x.mean(), y - y.mean()
    most = min(int(_LONGEST_LAG_S / dt), len(x) // 4)
    shifts = np.arange(-most, most + 1)
    scores = np.array([_correlation(x, y, shift) for shift in shifts])
    inside = np.flatnonzero((scores[1:-1] >= scores[:-2]) & (scores[1:-1] >= scores[2:])) + 1
    if not len(inside) or scores[inside].max() < _LEAST_CORRELATION:
        return None
    alike = inside[scores[inside] > scores[inside].max() - _AS_GOOD]  # a periodic motion repeats its peaks
    best = int(alike[np.argmin(np.abs(shifts[alike]))])
    left, middle, right = scores[best - 1 : best + 2]
    curvature = left - 2.0 * middle + right
    inner = 0.5 * (left - right) / curvature if curvature < 0 else 0.0  # vertex of the parabola through three scores
    return float((shifts[best] + inner) * dt)


def _correlation(x: np.ndarray, y: np.ndarray, shift: int) -> float:
    """Correlation of x(t) with y(t + shift)."""
    a, b = (x[: len(x) - shift], y[shift:]) if shift >= 0 else (x[-shift:], y[:shift])
    scale = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / scale) if scale > 0 else 0.0
