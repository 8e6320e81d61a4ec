"""Where the fits start: the rate of the loop and what the drive adds for the speed, before anything is fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import all_parameters
from hqpipe.layers.torque.joint import TorqueJoint

RATES = (40.0, 80.0, 150.0, 280.0)  # 1/s: force loops of 5 to 50 Hz; assumption
SHARES = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Compensations that are tried, in usual effort per usual speed; assumption: a factor of two apart."""


def likely_start(
    model: TorqueJoint, per_speed: float, fastest: float, opening_of: Callable[[float], tuple[float, float]]
) -> tuple[float, float]:
    """The rate and the compensation that, with at most one effect of the valve, leave the smallest error.

    Behind a wide deadband a first-order loop through the logs is slow, and a prompt linear valve does not show the
    compensation: a fit that starts there does not find the edges of the valve. Each compensation is tried with every rate and
    effect, offset, leak and speed share as they fit best, and the best of these are fitted.

    Args:
        per_speed: usual effort per usual speed. fastest: 1/s, rate that the simulation bears.
        opening_of: compensation → (usual, largest) opening of the valve.
    """
    names = [p.name for p in all_parameters(model)]
    neutral = np.array([p.neutral for p in all_parameters(model)])
    rate, compensation = names.index("rate"), names.index("compensation")
    rates = [each for each in dict.fromkeys((float(neutral[rate]), *RATES)) if each <= fastest]
    fitter = Fitter(model)
    best, found = np.inf, (float(neutral[rate]), 0.0)
    for share in SHARES:
        start = neutral.copy()
        start[compensation] = share * per_speed
        openings = opening_of(start[compensation])
        left, values, name = min(_tried(model, start, names, rates, openings), key=lambda tried: tried[0])
        if not np.isfinite(left):
            continue
        free = np.arange(len(model.base))
        if name:
            free = np.append(free, names.index(name))
        solution = fitter.fit(free, [values], left / len(model.fit.trial))
        if solution.square < best:
            best = solution.square
            found = (float(solution.values[rate]), float(solution.values[compensation]))
    return found


def _tried(
    model: TorqueJoint, start: np.ndarray, names: list[str], rates: list[float], openings: tuple[float, float]
) -> Iterator[tuple[float, np.ndarray, str]]:
    """Squared error, values and effect of each try with one compensation."""
    for rate in rates:
        for name, number in _tries(*openings, start[names.index("delay_s")]):
            if name and name not in names:
                continue
            values = start.copy()
            values[names.index("rate")] = rate
            if name:
                values[names.index(name)] = number
            yield _left(model, values, names), values, name


def _tries(usual: float, full: float, delay: float) -> Iterator[tuple[str, float]]:
    """Effects of a valve, each with sizes from slight to strong."""
    yield "", 0.0
    yield from (("limit", part * full) for part in (0.8, 0.6, 0.4, 0.25))
    yield from (("half_width", part * usual) for part in (0.1, 0.3, 0.6))
    yield from (("play", part * usual) for part in (0.03, 0.1, 0.3))
    yield from (("ratio", ratio) for ratio in (-0.15, 0.15))
    yield from (("delay_s", delay + more) for more in (0.005, 0.012, 0.025))
    yield "droop", 0.25
    yield "time_constant_s", 0.004


def _left(model: TorqueJoint, values: np.ndarray, names: list[str]) -> float:
    """Squared error with the offset, leak and speed share that fit best, to first order."""
    error, columns = model.error(values), []
    for name in ("speed_share", "offset", "leak"):
        moved, step = values.copy(), max(1e-2 * abs(values[names.index(name)]), 1e-3)
        moved[names.index(name)] += step
        columns.append((model.error(moved) - error) / step)
    slopes = np.column_stack(columns)
    if not (np.isfinite(error).all() and np.isfinite(slopes).all()):
        return np.inf
    numbers = np.linalg.lstsq(slopes, error, rcond=None)[0]
    left = error - slopes @ numbers
    return float(left @ left)
