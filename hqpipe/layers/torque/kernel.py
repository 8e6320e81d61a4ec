"""The torque of a force loop from its command: all effects at once, each inert at its neutral value.

error    delayed command less torque, plus what the drive adds for the speed, plus its integral
spool    first-order lag of the error, with a play, within ± limit; the deadband is cut out of it
flow     spool × direction × curve × load × supply × drift
torque   its rate is gain × geometry × (flow + offsets, less what the motion of the joint takes away)
effort   the torque less the friction between the drive and the sensor
"""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

LAYOUT = (
    "rate", "speed_share", "offset", "compensation", "row_offset_s", "speed_lead_s",
    "delay_s", "difference_s", "time_constant_s", "play", "limit", "inverse_stall", "half_width", "ki",
    "ratio", "curve", "inverse_effort_max", "area_ratio", "droop", "recovery_s", "drawn_ratio", "evened_out", "others",
    "rate_per_s", "gain_step", "moment_s", "geometry_1", "geometry_2",
    "offset_1", "offset_2", "speed_1", "speed_2", "turbulent", "drag", "leak", "leak_curve", "drift",
    "friction_nm", "coefficient",
    "dt", "error_scale", "speed_scale", "effort_scale", "most_effort", "longest_s",
)  # fmt: skip
(
    RATE, SPEED, OFFSET, COMPENSATION, ROW_OFFSET, LEAD,
    DELAY, DIFFERENCE, LAG, PLAY, LIMIT, INVERSE_STALL, BAND, KI,
    RATIO, CURVE, INVERSE_EFFORT, AREAS, DROOP, RECOVERY, DRAWN, EVENED, OTHERS, DRIFTING,
    STEP, MOMENT, GEOMETRY_1, GEOMETRY_2,
    OFFSET_1, OFFSET_2, SPEED_1, SPEED_2, TURBULENT, DRAG, LEAK, LEAK_CURVE, DRIFT,
    FRICTION, LOADED,
    DT, ERROR_SCALE, SPEED_SCALE, EFFORT_SCALE, MOST_EFFORT, LONGEST,
) = range(len(LAYOUT))  # fmt: skip

CLEARANCE = 0.035
"""Share of the half width over which the edge of a deadband is rounded: oil passes the clearance of the lands before the
spool opens (Merritt 1967, ch. 5: leakage at null)."""
CHANGE = 0.05  # of the longest trial, in which a sudden change of the gain happens; assumption: as in valve mode
SHUT = 0.05  # share of the pressure below which no drive evens it out; assumption
BURST = 20.0  # of the largest measured effort, which no prediction passes; assumption: a drive has no such reserve
TURNING = 0.02  # of the usual speed, over which a drag changes its sign; assumption: seals creep before they slide
SIGNALS = 7
TIME, Z, VELOCITY, OTHER_SPEED, LOSS, COMMAND_SUM, EFFORT_SUM = range(SIGNALS)
"""Rows of the logged signals: s since the trial began; position over its travel, −1 … 1; velocity; summed speed of the
other joints, each over its usual speed; measured loss of supply pressure, 0 … 1; integrals of the command and the effort
over time, their difference of no mean in each stretch."""
MEAN_ERROR, MEAN_VELOCITY, MEAN_EFFORT = range(3)
"""Columns of the means over the stretch of a block."""


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
def between(values: np.ndarray, first: int, last: int, at: float) -> float:
    """A measured signal at a place between samples, on the straight line from one to the next."""
    whole = int(np.floor(at))
    here, following = values[min(max(whole, first), last)], values[min(max(whole + 1, first), last)]
    return here + (at - whole) * (following - here)


@njit(cache=True, nogil=True, inline="always")
def error_of(
    p: np.ndarray, sums: tuple, command: np.ndarray, bounds: tuple, at: float, length: float, torque: float
) -> float:
    """What the drive acts on: delayed command less torque, and its integral, in the substep from `at` on.

    Args:
        sums: integrals of command and effort, and what the integrator holds in the mean. bounds: first and last sample.
    """
    first, last = bounds
    delay = (p[ROW_OFFSET] + p[DELAY]) / p[DT]
    error = held_mean(command, first, last, at - delay, length) - torque
    if p[KI] != 0.0:
        asked, given, held = sums
        middle = at + 0.5 * length
        error += held + p[KI] * (between(asked, first, last, middle - delay) - between(given, first, last, middle))
    return error


@njit(cache=True, nogil=True, inline="always")
def by_direction(p: np.ndarray, past: np.ndarray, count: int, late: float, wanted: float) -> float:
    """The demand with one of its directions `late` substeps late; `past` holds the demands of the last substeps."""
    size, whole = past.shape[0], int(late)
    past[count % size] = wanted
    newer, older = past[(count - whole) % size], past[(count - 1 - whole) % size]
    before = newer + (late - whole) * (older - newer)
    above, below = (before, wanted) if p[DIFFERENCE] > 0.0 else (wanted, before)
    return max(above, 0.0) + min(below, 0.0)


@njit(cache=True, nogil=True, inline="always")
def opened(p: np.ndarray, spool: float, torque: float) -> float:
    """Opening of the valve in the unit of the torque error: within the stroke, beyond the deadband.

    A drive that evens out the load's share of the pressure opens further under load. Fully open it can do so no more.
    """
    found, limit = spool, p[LIMIT]
    if p[INVERSE_STALL] != 0.0:
        against = torque if spool > 0.0 else -torque
        limit *= np.sqrt(max(1.0 - p[INVERSE_STALL] * against, 0.0))
    found = min(max(spool, -limit), limit)
    if p[BAND] == 0.0:
        return found
    corner, size = CLEARANCE * p[BAND], abs(found)
    excess = size - p[BAND]
    if excess <= -corner:
        return 0.0
    beyond = excess if excess >= corner else 0.25 * (excess + corner) ** 2 / corner
    return beyond if found > 0.0 else -beyond


@njit(cache=True, nogil=True, inline="always")
def flow_of(p: np.ndarray, opening: float, torque: float, time: float, sag: float) -> float:
    """Flow over the flow gain for an opening; `sag` is the relative loss of supply pressure."""
    flow = opening + p[RATIO] * abs(opening)
    flow *= 1.0 + p[CURVE] * abs(opening) / p[ERROR_SCALE]
    against = torque if opening > 0.0 else -torque
    # A drive that evens out the load's share of the pressure counts on the full supply: what is lost weighs more under load.
    lost = sag / max(1.0 - p[EVENED] * against / p[MOST_EFFORT], SHUT)
    inverse = p[INVERSE_EFFORT] if opening > 0.0 else p[INVERSE_EFFORT] / p[AREAS]
    pressure = 1.0 - lost - inverse * against
    flow *= np.sqrt(max(pressure, 0.0)) * max(1.0 + p[DRIFTING] * time, 0.0)
    if p[STEP] != 0.0:
        passed = (time - p[MOMENT]) / (CHANGE * p[LONGEST]) + 0.5
        flow *= max(1.0 + p[STEP] * min(max(passed, 0.0), 1.0), 0.0)
    return flow


@njit(cache=True, nogil=True, inline="always")
def beside_of(p: np.ndarray, v: float, torque: float, z: float, time: float) -> float:
    """What adds to the flow beside the valve, in the unit of the torque error."""
    found = p[OFFSET] + p[OFFSET_1] * z + p[OFFSET_2] * z * z
    share = v / p[SPEED_SCALE]
    found -= p[TURBULENT] * share * abs(share) + share * (p[SPEED_1] * z + p[SPEED_2] * z * z)
    found -= p[DRAG] * share / np.sqrt(share * share + TURNING * TURNING)
    found -= p[LEAK] * torque + p[LEAK_CURVE] * torque * abs(torque) / p[EFFORT_SCALE]
    return found + p[DRIFT] * (time / p[LONGEST] - 0.5)


@njit(cache=True, nogil=True, inline="always")
def lost_before_sensor(p: np.ndarray, v: float, torque: float) -> float:
    """Torque that friction between the drive and the sensor takes."""
    share = v / p[SPEED_SCALE]
    direction = share / np.sqrt(share * share + TURNING * TURNING)
    return (p[FRICTION] + p[LOADED] * abs(torque)) * direction


@njit(cache=True, nogil=True, inline="always")
def held_by_integral(p: np.ndarray, means: np.ndarray) -> float:
    """What an integrator holds in the mean of a stretch: what balances it, as far as it comes to rest within a trial."""
    balance = p[SPEED] * means[MEAN_VELOCITY] + p[LEAK] * means[MEAN_EFFORT] - p[OFFSET] - means[MEAN_ERROR]
    return balance * (1.0 - np.exp(-p[KI] * p[LONGEST]))


@njit(cache=True, nogil=True)
def run_blocks(
    p: np.ndarray,
    command: np.ndarray,
    effort: np.ndarray,
    signals: np.ndarray,
    means: np.ndarray,
    restart: np.ndarray,
    first: np.ndarray,
    last: np.ndarray,
    start: np.ndarray,
    stop: np.ndarray,
    substeps: int,
    torque: np.ndarray,
) -> None:
    """Fill the measured torque at each sample, (T,), block by block.

    Args:
        p: as in `LAYOUT`. command, effort: (T,). signals: (7, T). means: (B, 3).
        restart: (T,) whether the torque is set to the logged one.
        first, last: (B,) first and last sample of the stretch of each block. start, stop: (B,) its samples start … stop − 1.
        substeps: per sample.
    """
    h, length = p[DT] / substeps, 1.0 / substeps
    share, mean = 1.0, 1.0
    if p[LAG] > 0.0:
        share = 1.0 - np.exp(-h / p[LAG])
        mean = 1.0 - p[LAG] / h * share
    most = BURST * p[MOST_EFFORT]
    recovering = 1.0 - np.exp(-h / max(p[RECOVERY], 1e-9))
    late = abs(p[DIFFERENCE]) / h
    past = np.zeros(int(late) + 2)
    velocity = signals[VELOCITY]
    for b in range(start.shape[0]):
        x, slope, sag, count = effort[start[b]], 0.0, 0.0, 0
        spool = slack = 0.0
        bounds = (first[b], last[b])
        sums = (signals[COMMAND_SUM], signals[EFFORT_SUM], held_by_integral(p, means[b]) if p[KI] != 0.0 else 0.0)
        for k in range(start[b], stop[b]):
            lost = lost_before_sensor(p, velocity[k], effort[k])
            if restart[k]:
                x = effort[k] + lost
            torque[k] = x - lost
            measured = p[DROOP] * signals[LOSS, k]
            for i in range(substeps):
                at = k + i * length
                v = between(velocity, first[b], last[b], at + 0.5 * length + p[LEAD] / p[DT])
                z = between(signals[Z], first[b], last[b], at + 0.5 * length)
                time = signals[TIME, k] + (i + 0.5) * h
                middle = min(max(x + 0.5 * h * slope, -most), most)
                wanted = error_of(p, sums, command, bounds, at, length, middle) + p[COMPENSATION] * v
                if p[DIFFERENCE] != 0.0:
                    wanted = by_direction(p, past, count, late, wanted)
                    count += 1
                if p[PLAY] > 0.0:
                    slack = min(max(slack, wanted - p[PLAY]), wanted + p[PLAY])
                    wanted = slack
                seen = spool + mean * (wanted - spool) if mean < 1.0 else wanted
                spool += share * (wanted - spool)
                flow = flow_of(p, opened(p, seen, middle), middle, time, measured if measured != 0.0 else sag)
                if p[DROOP] != 0.0:
                    demand = (v if v > 0.0 else -v * p[DRAWN]) / p[SPEED_SCALE] + p[OTHERS] * signals[OTHER_SPEED, k]
                    sag += recovering * (p[DROOP] * demand - sag)
                gain = p[RATE] / (1.0 + p[LEAK]) * max(1.0 + p[GEOMETRY_1] * z + p[GEOMETRY_2] * z * z, 0.0)
                slope = gain * (flow + beside_of(p, v, middle, z, time) - (p[COMPENSATION] + p[SPEED]) * v)
                x = min(max(x + h * slope, -most), most)
