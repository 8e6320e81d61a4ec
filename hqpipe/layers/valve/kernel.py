"""The velocity of a valve-controlled joint from its command: all effects at once, each inert at its neutral value.

spool   first-order lag of the command, delayed by the dead time and held from sample to sample; a share of the opening may
        follow the edges with that lag instead
opening max(|spool − neutral| within ± limit − half_width, 0), and the jump beyond the edge
flow    opening × direction × flow curve × geometry × load × pressure × drift
speed   gain × flow + leakage, within the speed limits, behind a second-order response
"""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

LAYOUT = (
    "gain", "neutral", "row_offset_s", "half_width", "jump", "delay_s", "difference_s", "time_constant_s",
    "behind_edges", "play", "limit", "ratio", "inverse_effort_max", "area_ratio", "load_relief",
    "droop", "recovery_s", "drawn_ratio", "other_kinds", "rate_per_s", "speed_limit", "upper_speed", "lower_speed", "curve",
    "geometry_1", "geometry_2", "load_sin", "load_cos", "others", "creep_speed", "creep_position", "speed_per_effort",
    "gain_step", "moment_s", "period_s", "damping_ratio", "dt", "command_scale", "own_demand", "longest_s",
)  # fmt: skip
(
    GAIN, NEUTRAL, ROW_OFFSET, BAND, JUMP, DELAY, DIFFERENCE, LAG,
    BEHIND, PLAY, LIMIT, RATIO, INVERSE_EFFORT, AREAS, RELIEF,
    DROOP, RECOVERY, DRAWN, KINDS, RATE, ONE_WAY, UPPER, LOWER, CURVE,
    GEOMETRY_1, GEOMETRY_2, LOAD_SIN, LOAD_COS, OTHERS, CREEP, CREEP_POSITION, YIELD,
    STEP, MOMENT, PERIOD, DAMPING, DT, SCALE, OWN_DEMAND, LONGEST,
) = range(len(LAYOUT))  # fmt: skip

CLEARANCE = 0.035
"""Share of the half width over which the edge of a deadband is rounded: oil passes the clearance of the lands before the
spool opens (Merritt 1967, ch. 5: leakage at null)."""
LEAST_BAND = 0.1
"""Of the command's largest distance from rest: the edge of a jump is no sharper than that of such a deadband; assumption: a fit
then finds the edge."""
CHANGE = 0.05
"""Share of the longest trial in which a sudden change of the gain happens: much less than a drift takes, and so long that a fit
finds the moment; assumption."""
TIME, Z, SIN, COS, EFFORT, OTHER_SPEED, OTHER_OPENING, LOSS, FREE, OTHER_KIND = range(10)
"""Rows of the logged signals: s since the trial began; position over its travel, −1 … 1; sine and cosine of the angle, or the
same position and its square; effort; summed speed of the other joints of this kind; summed opening of the other valves, 0 … 1;
measured loss of supply pressure, 0 … 1; 1 where the joint is free to move, 0 where it is held and draws no flow; summed
speed of the joints of the other kind, brought to the size of this one's."""


@njit(cache=True, nogil=True, inline="always")
def held_mean(command: np.ndarray, first: int, last: int, start: float, length: float) -> float:
    """Mean of a command held from sample to sample, from `start` for `length` ≤ 1 samples."""
    whole = int(np.floor(start))
    here = command[min(max(whole, first), last)]
    over = start + length - (whole + 1.0)
    if over <= 0.0:
        return here
    following = command[min(max(whole + 1, first), last)]
    return here + over / length * (following - here)


@njit(cache=True, nogil=True, inline="always")
def driving(p: np.ndarray, command: np.ndarray, first: int, last: int, at: float, length: float) -> float:
    """The command that reaches the valve from sample `at` on, for `length` samples.

    The part of the command that moves the joint one way may take longer than the other part, as through another pilot stage.
    """
    delay = (p[ROW_OFFSET] + p[DELAY]) / p[DT]
    driven = held_mean(command, first, last, at - delay, length)
    if p[DIFFERENCE] == 0.0:
        return driven
    late = held_mean(command, first, last, at - delay - abs(p[DIFFERENCE]) / p[DT], length)
    above, below = (late, driven) if (p[GAIN] > 0.0) == (p[DIFFERENCE] > 0.0) else (driven, late)
    return p[NEUTRAL] + max(above - p[NEUTRAL], 0.0) + min(below - p[NEUTRAL], 0.0)


@njit(cache=True, nogil=True, inline="always")
def shares(lag: float, h: float) -> tuple[float, float]:
    """Share of the way to a held target that a first-order lag goes in h s, at the end and on average."""
    if lag == 0.0:
        return 1.0, 1.0
    share = 1.0 - np.exp(-h / lag)
    return share, 1.0 - lag / h * share


@njit(cache=True, nogil=True, inline="always")
def beyond(excess: float, corner: float) -> float:
    """max(excess, 0) with a parabola of half width `corner` round the edge."""
    if corner == 0.0 or excess >= corner:
        return max(excess, 0.0)
    if excess <= -corner:
        return 0.0
    return 0.25 * (excess + corner) ** 2 / corner


@njit(cache=True, nogil=True, inline="always")
def opened(p: np.ndarray, spool: float) -> float:
    """Opening of the valve, command units: within the stroke, beyond the deadband, after a jump at its edge.

    The jump is a share of the opening at the full command, which it leaves as it is.
    """
    error = min(max(spool - p[NEUTRAL], -p[LIMIT]), p[LIMIT])
    if p[BAND] == 0.0 and p[JUMP] == 0.0:
        return error
    corner = CLEARANCE * p[BAND] if p[JUMP] == 0.0 else CLEARANCE * max(p[BAND], LEAST_BAND * p[SCALE])
    found = beyond(error - p[BAND], corner) - beyond(-error - p[BAND], corner)
    if p[JUMP] == 0.0:
        return found
    up = min(max(0.5 * (error - p[BAND] + corner) / corner, 0.0), 1.0)
    down = min(max(0.5 * (-error - p[BAND] + corner) / corner, 0.0), 1.0)
    return (1.0 - p[JUMP]) * found + p[JUMP] * max(p[SCALE] - p[BAND], 0.0) * (up - down)


@njit(cache=True, nogil=True, inline="always")
def stepped(p: np.ndarray, time: float) -> float:
    """Factor of the gain: 1 before the moment at which it changes, another one after it."""
    if p[STEP] == 0.0:
        return 1.0
    passed = (time - p[MOMENT]) / (CHANGE * p[LONGEST]) + 0.5
    return max(1.0 + p[STEP] * min(max(passed, 0.0), 1.0), 0.0)


@njit(cache=True, nogil=True, inline="always")
def speed_of(p: np.ndarray, opening: float, s: np.ndarray, k: int, sag: float) -> float:
    """Velocity in the steady state for an opening at sample `k`; `sag` is the relative loss of supply pressure."""
    size = abs(opening) / p[SCALE]
    flow = opening + p[RATIO] * abs(opening)
    flow *= 1.0 + p[CURVE] * size
    flow *= 1.0 + p[GEOMETRY_1] * s[Z, k] + p[GEOMETRY_2] * s[Z, k] * s[Z, k]
    flow += abs(flow) * (p[LOAD_SIN] * s[SIN, k] + p[LOAD_COS] * s[COS, k])
    flow *= 1.0 + p[OTHERS] * s[OTHER_OPENING, k]
    load = p[INVERSE_EFFORT] * s[EFFORT, k]
    if p[GAIN] * opening < 0.0:
        load = -load / p[AREAS]
    if load < 0.0:  # it pulls with the motion
        load *= 1.0 - p[RELIEF]
    flow *= np.sqrt(max(1.0 - sag - load, 0.0)) * max(1.0 + p[RATE] * s[TIME, k], 0.0)
    flow *= stepped(p, s[TIME, k])
    creep = p[CREEP] + p[CREEP_POSITION] * s[Z, k] - p[YIELD] * s[EFFORT, k]
    speed = min(max(p[GAIN] * flow + creep, -p[LOWER]), p[UPPER])
    return min(speed, p[ONE_WAY]) if p[ONE_WAY] > 0.0 else max(speed, p[ONE_WAY])


@njit(cache=True, nogil=True)
def run_blocks(
    p: np.ndarray,
    command: np.ndarray,
    signals: np.ndarray,
    first: np.ndarray,
    last: np.ndarray,
    start: np.ndarray,
    kept: np.ndarray,
    stop: np.ndarray,
    substeps: int,
    velocity: np.ndarray,
) -> None:
    """Fill the mean velocity from each sample to the next, (T,), block by block.

    A block begins in the steady state of its first command and knows the commands before it.

    Args:
        p: as in `LAYOUT`. command: (T,). signals: (10, T).
        first, last: (B,) first and last sample of the stretch of each block. start, stop: (B,) its samples start … stop − 1.
        kept: (B,) sample from which its velocity is kept: before it the block settles.
        substeps: per sample.
    """
    h, length = p[DT] / substeps, 1.0 / substeps
    share, mean = shares(p[LAG], h)
    lags_behind = p[LAG] > 0.0 and p[BEHIND] > 0.0
    recovering = 1.0 - np.exp(-h / max(p[RECOVERY], 1e-9))
    omega = 2.0 * np.pi / max(p[PERIOD], 1e-9)
    damped = 1.0 / (1.0 + 2.0 * p[DAMPING] * omega * h + (omega * h) ** 2)
    for b in range(start.shape[0]):
        slack = driving(p, command, first[b], last[b], start[b], length)
        spool, flowing = slack, opened(p, slack)
        sag, moving, rising, begun = 0.0, 0.0, 0.0, False
        for k in range(start[b], stop[b]):
            total = 0.0
            measured = p[DROOP] * signals[LOSS, k]
            for i in range(substeps):
                driven = driving(p, command, first[b], last[b], k + i * length, length)
                if p[PLAY] > 0.0:
                    slack = min(max(slack, driven - p[PLAY]), driven + p[PLAY])
                    driven = slack
                seen = spool + mean * (driven - spool) if mean < 1.0 else driven
                spool += share * (driven - spool)
                opening = opened(p, seen)
                if lags_behind:
                    target = opened(p, driven)
                    opening += p[BEHIND] * (flowing + mean * (target - flowing) - opening)
                    flowing += share * (target - flowing)
                v = speed_of(p, opening, signals, k, measured if measured != 0.0 else sag)
                if p[DROOP] != 0.0:
                    drawn = v if v > 0.0 else -v * p[DRAWN]
                    others = signals[OTHER_SPEED, k] + p[KINDS] * signals[OTHER_KIND, k]
                    demand = others + p[OWN_DEMAND] * signals[FREE, k] * drawn
                    sag += recovering * (p[DROOP] * demand - sag)
                if p[PERIOD] > 0.0:
                    if not begun:
                        moving, begun = v, True
                    rising = (rising + h * omega * omega * (v - moving)) * damped
                    moving += h * rising
                    v = moving
                total += v
            if k >= kept[b]:
                velocity[k] = total * length


@njit(cache=True, nogil=True)
def travelled(
    velocity: np.ndarray,
    position: np.ndarray,
    begin: np.ndarray,
    begin_samples: int,
    sample: np.ndarray,
    window: np.ndarray,
    dt: float,
    error: np.ndarray,
) -> None:
    """Fill the error of the position, free-running from the start of each window, (N,).

    The position at the start is the mean of what the samples before it say: each is carried on by the model.

    Args:
        velocity, position: (T,). begin: (W,) sample at which each window starts.
        begin_samples: that its position is taken from.
        sample: (N,) of the prediction, in the order of time within a window. window: (N,) index into `begin`.
    """
    current, at, place = -1, 0, 0.0
    for n in range(sample.shape[0]):
        if window[n] != current:
            current = window[n]
            at, place = begin[current], 0.0
            offset, back = position[at], 0.0
            for m in range(1, begin_samples):
                back += dt * velocity[at - m]
                offset += position[at - m] + back
            place = offset / begin_samples
        while at < sample[n]:
            place += dt * velocity[at]
            at += 1
        error[n] = place - position[sample[n]]
