"""The command side of an actuator with effects, from the logged command to the opening of the valve."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.command_delay import delayed
from hqpipe.machine.direction_asymmetry import asymmetric
from hqpipe.machine.flow_saturation import saturate
from hqpipe.machine.gain_drift import drifted
from hqpipe.machine.integral_action import integrate, wound_up_for
from hqpipe.machine.leakage_drift import leaked
from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    ASYMMETRY,
    BAND,
    BEHIND,
    BIAS,
    COMPLIANCE,
    COMPRESSION,
    DELAY,
    DRIFT,
    DROOP,
    DT,
    HELD,
    HELD_CLOSE,
    HELD_PASSES,
    K1,
    K2,
    K3,
    K4,
    KI,
    LAG,
    LEAK_DRIFT,
    MIDDLE,
    OFFSET,
    ORIFICE,
    POSITION,
    ROUNDING,
    SATURATION,
    SKEW,
    SLOPE,
    SPRINGY,
    TORQUE,
    UNEVEN,
    VALVE_DELAY,
    VISCOUS,
    WINDUP,
)
from hqpipe.machine.loops.augmented_signals import Signals, Work, lag_behind, lay_out
from hqpipe.machine.loops.laws import impact
from hqpipe.machine.orifice_flow import balance, orifice
from hqpipe.machine.position_dependent_stiffness import displaced, lean, stiffness, uneven
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_deadband import deadband
from hqpipe.machine.valve_lag import follow, lag_share, mean_share, swing
from hqpipe.machine.viscous_friction import relaxation


@njit(cache=True, nogil=True, inline="always")
def shape_opening(p: np.ndarray, opening: float, time: float) -> float:
    """The command side from the spool on."""
    opening = saturate(deadband(opening, p[BAND], p[ROUNDING]), p[SATURATION])
    return drifted(asymmetric(opening, p[ASYMMETRY] + uneven(p[SLOPE], p[UNEVEN])), p[DRIFT], time)


@njit(cache=True, nogil=True, inline="always")
def piston_lag(p: np.ndarray) -> float:
    """Time constant, s, with which opening and speed reach a joint whose piston rubs."""
    return relaxation(p[VISCOUS], p[BEHIND], p[K3] / p[DT])


@njit(cache=True, nogil=True)
def command_side(p: np.ndarray, s: Signals, work: Work) -> None:
    """Fill `opening`: u in position mode; in torque mode the delayed command, and the states at the start of each
    window as the logged effort drives them."""
    dt, sequence = p[DT], work.command
    share, mean = lag_share(p[LAG], dt), mean_share(p[LAG], dt)
    prompt = p[SKEW] == 0.0 and p[DELAY] == 0.0
    bent, shift = shaped(p), p[BIAS] if s.mode == POSITION else 0.0
    sent_late = s.mode == POSITION and p[VALVE_DELAY] != 0.0
    swings = s.mode == POSITION and p[SPRINGY] != 0.0 and p[LAG] != 0.0
    yy, yv, vy, vv, my, mv = swing(p[LAG], p[SPRINGY], dt)
    for trial in range(s.bounds.shape[0] - 1):
        first, last = s.bounds[trial], s.bounds[trial + 1] - 1
        integral, spool, rate = 0.0, 0.0, 0.0
        if p[KI] != 0.0:
            integral = held(p, s, work, trial)
        for k in range(first, last + 1):
            at = k - p[SKEW] / dt
            wanted = s.command[k] if prompt else delayed(s.command, first, last, at, p[DELAY] / dt)
            if s.mode == POSITION:
                here = s.position[k] if p[SKEW] == 0.0 else delayed(s.position, first, last, at, 0.0)
                error = wanted - here
            else:
                error = wanted - s.effort[k] + p[OFFSET]
            driven = error + integral + shift
            if sent_late:
                work.driven[k] = driven
                driven = delayed(work.driven, first, k, k, p[VALVE_DELAY] / dt) if k > first else driven
            spool = driven if k == first else spool
            if s.mode == TORQUE:
                sequence[k], work.driven[k], work.summed[k] = wanted, spool, integral
            else:
                behind = spool - driven
                opening = driven + my * behind + mv * rate if swings else follow(spool, driven, mean)
                sequence[k] = shape_opening(p, opening, s.time[k]) if bent else opening
            integral = integrate(integral, error, p[KI], p[WINDUP], dt)
            if swings:
                spool, rate = driven + yy * behind + yv * rate, vy * behind + vv * rate
            else:
                spool = follow(spool, driven, share)
    if s.mode == POSITION:
        lag_behind(work.command, s.bounds, piston_lag(p), dt)
    lay_out(work.command, s.first, work.opening)
    if s.mode == TORQUE:
        for w in range(s.first.shape[0]):
            work.spool[w] = work.driven[s.first[w]]
            work.integral[w] = work.summed[s.first[w]]


@njit(cache=True, nogil=True)
def held(p: np.ndarray, s: Signals, work: Work, trial: int) -> float:
    """What the integrator holds when a trial starts: what makes the openings add up to the change of torque.

    Logs begin in the middle of operation, so it is not zero, and a wrong start would last: until the integrator first
    stands at its limit, else through the whole trial. Where it is known for how long the joint had been held before, it is
    what has wound up since.
    """
    first, last = s.bounds[trial], s.bounds[trial + 1] - 1
    if p[HELD] >= 0.0 and s.mode == POSITION and s.time[first] == 0.0:
        return wound_up_for(s.command[first] - s.position[first], p[KI], p[WINDUP], p[HELD])
    soft, offset = softened(p[K3], p[COMPLIANCE], p[DT]), 0.0 if s.mode == POSITION else p[OFFSET]
    prompt, even = p[SKEW] == 0.0 and p[DELAY] == 0.0, balance(p[AREAS], p[ORIFICE])
    for k in range(first, last):
        wanted, here = s.command[k], s.position[k] if s.mode == POSITION else s.effort[k]
        if not prompt:
            at = k - p[SKEW] / p[DT]
            here = delayed(s.position, first, last, at, 0.0) if s.mode == POSITION else here
            wanted = delayed(s.command, first, last, at, p[DELAY] / p[DT])
        work.sequence[k] = wanted - here + offset
        work.stiff[k] = soft * stiffness(p[SLOPE], s.position[k] - p[MIDDLE])
        velocity = displaced(s.velocity[k], work.middling[k], p[COMPRESSION])
        leak = leaked(p[K2], p[LEAK_DRIFT], s.time[k])
        work.other[k] = work.stiff[k] * (leak * (s.effort[k] - p[OFFSET] - even) + p[K3] * velocity)
    limit = 1.0 / max(p[WINDUP], 1e-300)
    low, high, start = -limit, limit, min(max(work.held[trial], -limit), limit)
    for _ in range(HELD_PASSES):
        missing, samples = _missing(p, s, work, first, last, start)
        if missing > 0.0:
            low = start
        else:
            high = start
        wanted = start + missing / max(p[K1] * samples, 1e-300)
        if wanted <= low or wanted >= high:  # the limit takes from what the start is worth
            wanted = 0.5 * (low + high)
        close = abs(wanted - start) < HELD_CLOSE * abs(wanted)
        start = wanted
        if close:
            break
    work.held[trial] = start if np.isfinite(start) else 0.0
    return start


@njit(cache=True, nogil=True)
def _missing(p: np.ndarray, s: Signals, work: Work, first: int, last: int, start: float) -> tuple[float, int]:
    """Change of torque that an integrator which starts at `start` leaves open, N·m, and over how many samples.

    The spool's lag and delay cancel in the sum.
    """
    integral, bent, change, end, leaning = start, shaped(p), 0.0, last, lean(p[SLOPE])
    bent_flow = p[ORIFICE] != 0.0 or p[DROOP] != 0.0 or p[K4] != 0.0
    limit, shift = 1.0 / max(p[WINDUP], 1e-300), p[BIAS] if s.mode == POSITION else 0.0
    for k in range(first, last):
        error = work.sequence[k]
        opening = error + integral + shift
        if bent:
            opening = shape_opening(p, opening, s.time[k])
        change -= work.other[k]
        if bent_flow:
            effort = s.effort[k] - p[OFFSET]
            flow = (
                p[K1]
                * opening
                * orifice(opening, effort, p[ORIFICE], work.sagged[k], work.middling[k], leaning, p[AREAS])
            )
            change += work.stiff[k] * (flow + p[K4] * impact(effort, opening))
        else:
            change += work.stiff[k] * p[K1] * opening
        integral = integrate(integral, error, p[KI], p[WINDUP], p[DT])
        if abs(integral) >= limit and k - first >= s.steps:
            end = k + 1
            break
    return s.effort[end] - s.effort[first] - change, end - first


@njit(cache=True, nogil=True, inline="always")
def shaped(p: np.ndarray) -> bool:
    """Whether the opening is anything but what the spool follows."""
    bent = p[BAND] != 0.0 or p[SATURATION] != 0.0 or p[ASYMMETRY] != 0.0 or p[DRIFT] != 0.0
    return bent or p[UNEVEN] != 0.0
