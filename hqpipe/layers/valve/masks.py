"""Samples at which the valve does not decide the motion: at an end stop, or where something blocks the machine."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.valve.record import Record, Scales

HOLD_S, HOLD_ROWS = 0.1, 5
"""Least length of a rest at an end stop; shorter ones are turning points. assumption: as in hqpipe.logs.survey.end_stop."""
NEAR = 0.01  # of the travel, within which an end stop lies; assumption: its rubber or oil cushion gives by that much
CONTACT, CONTACT_NOISE = 0.002, 4.0  # of the travel, and of the sensor's noise, within which a joint touches its stop
STILL = 0.05  # of the usual speed: the joint stands; assumption: below what a loaded cylinder creeps
COMMAND_STEPS = 20  # classes of the command for the usual speed; assumption: finer than any corner of a valve's curve
BLOCKED_S = 0.2  # assumption: shorter stops are the dead time and lag of the valve
EXPECTED = 0.3  # of the usual speed: a command that moves the joint at least so fast elsewhere is beyond the deadband
BLOCKED_SHARE = 0.1  # of the driven samples; where more stand still, that is how the machine is; assumption
SETTLED_S = 0.5  # for which the command has been that large; longer than dead time and lag of a valve; assumption
FEWEST = 20  # samples of a class; assumption


def runs(flags: np.ndarray, stretch: np.ndarray) -> list[tuple[int, int]]:
    """Start and stop of each run of True that stays within a stretch. flags, stretch: (N,)."""
    change = np.flatnonzero((np.diff(flags.astype(np.int8)) != 0) | (np.diff(stretch) != 0)) + 1
    edges = np.concatenate([[0], change, [len(flags)]])
    return [(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a and flags[a]]


def smooth_speed(record: Record, span: int) -> np.ndarray:
    """(N,) mean speed over `span` samples round each sample, unit of the position per s."""
    speed = np.zeros(len(record.position))
    for first, last in zip(record.first, record.last, strict=True):
        index = np.arange(first, last + 1)
        before, behind = np.maximum(index - span // 2, first), np.minimum(index + (span + 1) // 2, last)
        speed[index] = (record.position[behind] - record.position[before]) / np.maximum(behind - before, 1) / record.dt
    return speed


def at_end_stops(
    record: Record, scales: Scales, gain_sign: float, ends: tuple[float, float], noise: float
) -> np.ndarray:
    """(N,) whether the joint is at an end of its travel that holds it.

    An end of the travel is a stop where the joint stands near it for a while although its command pushes it on. Then every
    sample at it counts, however short: there the position says nothing of the valve.

    Args:
        gain_sign: of speed over command. ends: lowest and highest position of all trials. noise: of the position.
    """
    span = max(HOLD_ROWS, round(HOLD_S / record.dt))
    still = np.abs(smooth_speed(record, span)) < STILL * scales.speed
    push = gain_sign * (record.command - scales.rest)
    travel = 2.0 * scales.half_travel
    contact = max(CONTACT_NOISE * noise, CONTACT * travel)
    found = np.zeros(len(still), dtype=bool)
    for side, end in ((1.0, ends[1]), (-1.0, ends[0])):
        distance = side * (end - record.position)
        held = still & (distance < NEAR * travel) & (side * push > 0.0)
        rests = [(start, stop) for start, stop in runs(held, record.stretch) if stop - start >= span]
        for start, stop in rests:
            found[start:stop] = True
        if rests:
            found |= distance < contact
    return found


def usual_speeds(record: Record, scales: Scales, valid: np.ndarray, delay: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges of classes of the command and (C,) median speed at a command steadily in the class; NaN where it hardly was."""
    low, high = _extremes(record, round(SETTLED_S / record.dt) + delay)
    edges = np.linspace(scales.rest - scales.command, scales.rest + scales.command, COMMAND_STEPS + 1)
    speed = smooth_speed(record, max(round(0.1 / record.dt), 2))
    steady = valid & (high - low < 2.0 * scales.command / COMMAND_STEPS)
    kind = np.clip(np.searchsorted(edges, 0.5 * (low + high)) - 1, 0, COMMAND_STEPS - 1)
    median = np.full(COMMAND_STEPS, np.nan)
    for c in range(COMMAND_STEPS):
        here = steady & (kind == c)
        if here.sum() >= FEWEST:
            median[c] = np.median(speed[here])
    return edges, median


def _extremes(record: Record, span: int) -> tuple[np.ndarray, np.ndarray]:
    """(N,) lowest and highest command of the `span` samples up to each sample, within its stretch."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low, high = np.empty_like(record.command), np.empty_like(record.command)
    span = max(span, 1)
    for first, last in zip(record.first, record.last, strict=True):
        part = record.command[first : last + 1]
        options = {"origin": (span - 1) // 2, "mode": "nearest"}
        low[first : last + 1] = minimum_filter1d(part, span, **options)
        high[first : last + 1] = maximum_filter1d(part, span, **options)
    return low, high


def blocked(record: Record, scales: Scales, valid: np.ndarray, curve: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(N,) whether the joint stands although the command has long been one that moves it elsewhere.

    Args:
        curve: of `usual_speeds`, over the fit trials.
    """
    edges, median = curve
    nothing = np.zeros(len(valid), dtype=bool)
    known = np.isfinite(median)
    if known.sum() < 2:
        return nothing
    centre = 0.5 * (edges[1:] + edges[:-1])
    low, high = _extremes(record, round(SETTLED_S / record.dt))
    slow, fast = (np.interp(c, centre[known], median[known]) for c in (low, high))
    expected = np.where(slow * fast > 0.0, np.minimum(np.abs(slow), np.abs(fast)), 0.0)
    span = max(round(BLOCKED_S / record.dt), 2)
    still = np.abs(smooth_speed(record, span)) < np.minimum(0.1 * expected, STILL * scales.speed)
    driven = valid & (expected > EXPECTED * scales.speed)
    found = driven & still
    if found.sum() > BLOCKED_SHARE * max(driven.sum(), 1):
        return nothing
    for start, stop in runs(found, record.stretch):
        if stop - start < span:
            found[start:stop] = False
    return found
