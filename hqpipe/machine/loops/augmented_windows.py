"""An actuator with effects, driven by a log: free running in windows that restart from the logged output.

The chain, in this order (names as in hqpipe.machine):

    clock     channel_skew (all inputs), command_delay (command) → position error e
    command   integral_action → position_bias → valve_delay → valve_lag → valve_deadband → flow_saturation →
              direction_asymmetry (with what unequal chambers add to it) → gain_drift → u
    core      τ' = τ + S · (k1 φ u − k2 τ − k3 q̇ + k4 h(τ, u)),  φ = orifice_flow with supply_droop, k2 with leakage_drift,
              S = position_dependent_stiffness · transmission_compliance
    output    friction in front of the load cell, backlash, torque_bias: a seal rubs on the piston's side of the slack;
              where viscous friction holds the piston back, opening and speed come through its lag

In position mode the command side hangs on logged signals only and is computed once for all windows; windows
lie side by side in memory, so that the core runs over all of them at once. In torque mode e = τ_des − τ closes
the loop inside the core.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.backlash import transmitted, wound_up
from hqpipe.machine.command_delay import delayed
from hqpipe.machine.integral_action import integrate
from hqpipe.machine.leakage_drift import leaked
from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    CLEAR,
    COMMAND,
    COMPLIANCE,
    COMPRESSION,
    DROOP,
    DT,
    EXCHANGE,
    FOLLOW,
    GAP,
    K1,
    K2,
    K3,
    K4,
    KI,
    LAG,
    LEAK_DRIFT,
    LIMIT,
    MIDDLE,
    MOTION,
    OFFSET,
    ORIFICE,
    PUMP,
    RECOVERY,
    SKEW,
    SLIDE,
    SLOPE,
    SUPPLY,
    TORQUE,
    WINDUP,
)
from hqpipe.machine.loops.augmented_command import command_side, piston_lag, shape_opening
from hqpipe.machine.loops.augmented_output import follow_along, friction, grips, move, rub, rubs, slid, slide, unloaded
from hqpipe.machine.loops.augmented_signals import Signals, Work, lag_behind, lay_out
from hqpipe.machine.loops.laws import clip, impact
from hqpipe.machine.orifice_flow import balance, orifice
from hqpipe.machine.position_dependent_stiffness import displaced, exchanged, lean, stiffness
from hqpipe.machine.supply_droop import lacking, sag
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_lag import follow, lag_share, mean_share


@njit(cache=True, nogil=True)
def _motion(p: np.ndarray, s: Signals, work: Work) -> None:
    """Fill velocity, of the piston, and position as late as the torque is logged."""
    dt = p[DT]
    late = p[SKEW] / dt
    if late == 0.0:
        work.speed[:] = s.velocity
        lay_out(s.position, s.first, work.offset)
    else:
        for trial in range(s.bounds.shape[0] - 1):
            first, last = s.bounds[trial], s.bounds[trial + 1] - 1
            for k in range(first, last + 1):
                work.speed[k] = delayed(s.velocity, first, last, float(k), late)
                work.other[k] = delayed(s.position, first, last, float(k), late)
        lay_out(work.other, s.first, work.offset)
    lag_behind(work.speed, s.bounds, piston_lag(p), dt)
    lay_out(work.speed, s.first, work.velocity)
    move(p, s, work)


@njit(cache=True, nogil=True)
def _supply(p: np.ndarray, s: Signals, work: Work) -> None:
    """Fill the loss of supply pressure, and what the chambers' mean pressure is off by."""
    if p[DROOP] == 0.0:
        work.loss[:], work.mean[:] = 0.0, 0.0
        work.sagged[:], work.middling[:] = 0.0, 0.0
        return
    share = lag_share(p[RECOVERY], p[DT])
    for trial in range(s.bounds.shape[0] - 1):
        loss = max(p[DROOP] * lacking(s.demand[s.bounds[trial]], p[PUMP]), 0.0)  # as if that had been drawn for long
        mean = -loss
        for k in range(s.bounds[trial], s.bounds[trial + 1]):
            loss = sag(loss, lacking(s.demand[k], p[PUMP]), p[DROOP], share)
            mean = exchanged(mean, loss, _opened(s, k), p[EXCHANGE], p[DT])
            work.sagged[k], work.middling[k] = loss, mean
    lay_out(work.sagged, s.first, work.loss)
    lay_out(work.middling, s.first, work.mean)


@njit(cache=True, nogil=True, inline="always")
def _opened(s: Signals, k: int) -> float:
    """How far the controller's error opens the valve, in the unit of the command, whatever bends that on the way."""
    return s.command[k] - (s.effort[k] if s.mode == TORQUE else s.position[k])


@njit(cache=True, nogil=True, inline="always")
def shapes(p: np.ndarray) -> bool:
    """Whether the core differs from the base model's."""
    bent = p[ORIFICE] != 0.0 or p[DROOP] != 0.0 or p[LEAK_DRIFT] != 0.0
    return bent or p[SLOPE] != 0.0 or p[GAP] != 0.0 or p[COMPLIANCE] != 0.0


@njit(cache=True, nogil=True)
def _restart(p: np.ndarray, s: Signals, work: Work, anew: int) -> None:
    """Inner torque at the start of each window from the logged one: the output side turned round.

    The way that friction points there hangs on the core so little that it is found `anew` with the inputs only.
    """
    half = 0.5 * p[GAP] * p[K3] / p[DT]
    if half > 0.0 or (anew != 0 and grips(p)):
        follow_along(p, s, work, half)
    for w in range(s.first.shape[0]):
        effort, turned = s.target[0, w] - p[OFFSET], work.turned[w]
        inner = unloaded(p, effort, work.sliding[0, w], turned, work.sticking[0, w])
        if half > 0.0:
            lost = inner - effort
            inner = wound_up(work.other[s.first[w]] - lost, effort, half, p[CLEAR]) + lost
        work.state[w] = inner


@njit(cache=True, nogil=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def _plain(p: np.ndarray, s: Signals, work: Work, out: np.ndarray, bias: float) -> None:
    """Core without orifice, droop, stiffness and backlash, plus a bias."""
    k1, keep, k3, k4, limit = p[K1], 1.0 - p[K2], p[K3], p[K4], p[LIMIT]
    state = work.state
    for k in range(s.steps):
        opening, velocity, row = work.opening[k], work.velocity[k], out[k]
        for w in range(state.shape[0]):
            u, effort = opening[w], state[w]
            following = clip(keep * effort + k1 * u - k3 * velocity[w] + k4 * impact(effort, u), limit)
            state[w] = following
            row[w] = following + bias


@njit(cache=True, nogil=True, fastmath={"contract", "nsz", "arcp", "reassoc"})
def _full(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Core with every effect, backlash without friction; the friction of the output side follows in `rub`."""
    k1, k2, k3, k4, limit = p[K1], p[K2], p[K3], p[K4], p[LIMIT]
    inverse, slope, leaning, half = p[ORIFICE], p[SLOPE], lean(p[SLOPE]), 0.5 * p[GAP] * p[K3] / p[DT]
    soft, middle, compression = softened(k3, p[COMPLIANCE], p[DT]), p[MIDDLE], p[COMPRESSION]
    areas, even = p[AREAS], balance(p[AREAS], p[ORIFICE])
    state, warming, dt = work.state, p[LEAK_DRIFT], p[DT]
    began = s.time[s.first]
    for k in range(s.steps):
        opening, velocity, offset, row = work.opening[k], work.velocity[k], work.offset[k], out[k]
        loss, mean = work.loss[k], work.mean[k]
        for w in range(state.shape[0]):
            u = opening[w]
            effort = transmitted(state[w], half)
            passed = orifice(u, effort, inverse, loss[w], mean[w], leaning, areas)
            leak = leaked(k2, warming, began[w] + k * dt)
            change = k1 * u * passed - leak * (effort - even) - k3 * displaced(velocity[w], mean[w], compression)
            change += k4 * impact(effort, u)
            following = clip(state[w] + soft * stiffness(slope, offset[w] - middle) * change, limit)
            state[w] = following
            row[w] = transmitted(following, half)


@njit(cache=True, nogil=True)
def _slack(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Core and output where friction acts on the piston's side of a slack chain."""
    half, soft, leaning = 0.5 * p[GAP] * p[K3] / p[DT], softened(p[K3], p[COMPLIANCE], p[DT]), lean(p[SLOPE])
    even = balance(p[AREAS], p[ORIFICE])
    for w in range(work.state.shape[0]):
        state, turned = work.state[w], work.turned[w]
        inner = transmitted(state, half)
        lost = friction(p, inner, work.sliding[0, w], turned, work.sticking[0, w])
        for k in range(s.steps):
            u, velocity = work.opening[k, w], work.velocity[k, w]
            effort = transmitted(state - lost, half) + lost
            passed = orifice(u, effort, p[ORIFICE], work.loss[k, w], work.mean[k, w], leaning, p[AREAS])
            leak = leaked(p[K2], p[LEAK_DRIFT], s.time[s.first[w]] + k * p[DT])
            change = p[K1] * u * passed - leak * (effort - even)
            change -= p[K3] * displaced(velocity, work.mean[k, w], p[COMPRESSION])
            change += p[K4] * impact(effort, u)
            state = clip(state + soft * stiffness(p[SLOPE], work.offset[k, w] - p[MIDDLE]) * change, p[LIMIT])
            following = transmitted(state, half)
            turned = slid(p, turned, following - inner, following, velocity, work.kept[k, w])
            inner = following
            lost = friction(p, inner, work.sliding[k + 1, w], turned, work.sticking[k + 1, w])
            out[k, w] = transmitted(state - lost, half) + p[OFFSET]


@njit(cache=True, nogil=True)
def _torque_loop(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Core and output of torque mode: the force loop closes over the model's own torque, as the load cell feels it."""
    k1, k2, k3, limit, dt = p[K1], p[K2], p[K3], p[LIMIT], p[DT]
    half, soft, leaning = 0.5 * p[GAP] * k3 / dt, softened(k3, p[COMPLIANCE], dt), lean(p[SLOPE])
    share, mean = lag_share(p[LAG], dt), mean_share(p[LAG], dt)
    even = balance(p[AREAS], p[ORIFICE])
    for w in range(work.state.shape[0]):
        state, spool, integral = work.state[w], work.spool[w], work.integral[w]
        start, lost, rubbed = s.time[s.first[w]], 0.0, rubs(p)
        inner, turned = transmitted(state, half), work.turned[w]
        if rubbed:
            lost = friction(p, inner, work.sliding[0, w], turned, work.sticking[0, w])
        for k in range(s.steps):
            felt = transmitted(state - lost, half)
            effort = felt + lost
            error = work.opening[k, w] - felt
            driven = error + integral
            integral = integrate(integral, error, p[KI], p[WINDUP], dt)
            u = shape_opening(p, follow(spool, driven, mean), start + k * dt)
            spool = follow(spool, driven, share)
            passed = orifice(u, effort, p[ORIFICE], work.loss[k, w], work.mean[k, w], leaning, p[AREAS])
            change = k1 * u * passed - k2 * (effort - even)
            change -= k3 * displaced(work.velocity[k, w], work.mean[k, w], p[COMPRESSION])
            state = clip(state + soft * stiffness(p[SLOPE], work.offset[k, w] - p[MIDDLE]) * change, limit)
            if rubbed:
                following = transmitted(state, half)
                turned = slid(p, turned, following - inner, following, work.velocity[k, w], work.kept[k, w])
                inner = following
                lost = friction(p, inner, work.sliding[k + 1, w], turned, work.sticking[k + 1, w])
            out[k, w] = transmitted(state - lost, half) + p[OFFSET]


@njit(cache=True, nogil=True)
def simulate(p: np.ndarray, s: Signals, work: Work, out: np.ndarray, inputs: int) -> None:
    """Predict the logged output of all windows.

    Args:
        p: (WIDTH,) row of parameters, see hqpipe.machine.layout.
        s, work: data and scratch.
        out: (steps, W), overwritten; row k is the prediction of `target` row k + 1.
        inputs: what to compute anew beside the core, any of FOLLOW, COMMAND, SLIDE, SUPPLY and MOTION.
    """
    if inputs & MOTION:
        _motion(p, s, work)
    if inputs & SLIDE:
        slide(p, s, work)
    if inputs & SUPPLY:
        _supply(p, s, work)
    if inputs & COMMAND:
        command_side(p, s, work)
    _restart(p, s, work, inputs & FOLLOW)
    if s.mode == TORQUE:
        _torque_loop(p, s, work, out)
    elif rubs(p) and p[GAP] != 0.0:
        _slack(p, s, work, out)
    elif shapes(p):
        _full(p, s, work, out)
        rub(p, s, work, out)
    elif rubs(p):
        _plain(p, s, work, out, 0.0)
        rub(p, s, work, out)
    else:
        _plain(p, s, work, out, p[OFFSET])
