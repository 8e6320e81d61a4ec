"""An actuator with effects, driven by a log: free running in windows that restart from the logged output.

The chain, in this order (names as in hqpipe.effects):

    clock     channel_skew (all inputs), command_delay (command), position_bias → position error e
    command   integral_action → valve_lag → valve_deadband → flow_saturation → direction_asymmetry (with what unequal
              chambers add to it) → gain_drift → u
    core      τ' = τ + S · (k1 φ u − k2 τ − k3 q̇ + k4 h(τ, u)),  φ = orifice_flow with supply_droop,
              S = position_dependent_stiffness · transmission_compliance
    output    friction in front of the load cell, backlash, torque_bias: a seal rubs on the piston's side of the slack

In position mode the command side hangs on logged signals only and is computed once for all windows; windows
lie side by side in memory, so that the core runs over all of them at once. In torque mode e = τ_des − τ closes
the loop inside the core. In valve mode the output is the speed k1 φ u − k2 τ, without a state of its own.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.effects.backlash import transmitted, wound_up
from hqpipe.effects.command_delay import delayed
from hqpipe.effects.coulomb_friction import coulomb, direction, kept_after, stuck
from hqpipe.effects.direction_asymmetry import asymmetric
from hqpipe.effects.flow_saturation import saturate
from hqpipe.effects.gain_drift import drifted
from hqpipe.effects.integral_action import integrate
from hqpipe.effects.load_dependent_friction import load_friction
from hqpipe.effects.orifice_flow import orifice
from hqpipe.effects.position_dependent_stiffness import fed, stiffness, uneven
from hqpipe.effects.stribeck_friction import sticking
from hqpipe.effects.supply_droop import sag
from hqpipe.effects.transmission_compliance import softened
from hqpipe.effects.valve_deadband import deadband
from hqpipe.effects.valve_lag import follow, lag_share, mean_share
from hqpipe.effects.viscous_friction import viscous
from hqpipe.kernels.augmented_columns import (
    ALL,
    ASYMMETRY,
    BAND,
    BIAS,
    CLEAR,
    COMMAND,
    COMPLIANCE,
    COULOMB,
    COULOMB_ASYMMETRY,
    DELAY,
    DRIFT,
    DROOP,
    DT,
    EXPONENT,
    GAP,
    HELD_CLOSE,
    HELD_PASSES,
    K1,
    K2,
    K3,
    K4,
    KI,
    LAG,
    LEAST_PASSED,
    LIMIT,
    LOAD,
    MIDDLE,
    NEUTRAL,
    OFFSET,
    ORIFICE,
    POSITION,
    PRESLIDING,
    RECOVERY,
    ROUNDING,
    SATURATION,
    SKEW,
    SLOPE,
    STATIC,
    STRIBECK,
    TORQUE,
    UNEVEN,
    VALVE,
    VISCOUS,
    WINDUP,
)
from hqpipe.kernels.augmented_signals import Signals, Work, lay_out
from hqpipe.kernels.laws import clip, impact


@njit(cache=True, nogil=True, inline="always")
def shape_opening(p: np.ndarray, opening: float, time: float) -> float:
    """The command side from the spool on."""
    opening = saturate(deadband(opening, p[BAND], p[ROUNDING]), p[SATURATION])
    return drifted(asymmetric(opening, p[ASYMMETRY] + uneven(p[SLOPE], p[UNEVEN])), p[DRIFT], time)


@njit(cache=True, nogil=True)
def _command_side(p: np.ndarray, s: Signals, work: Work) -> None:
    """Fill `opening`: u in position and valve mode; in torque mode the delayed command, and the states at the
    start of each window as the logged effort drives them."""
    dt, sequence = p[DT], work.command
    share, mean = lag_share(p[LAG], dt), mean_share(p[LAG], dt)
    prompt = p[SKEW] == 0.0 and p[DELAY] == 0.0
    bent = shaped(p)
    for trial in range(s.bounds.shape[0] - 1):
        first, last = s.bounds[trial], s.bounds[trial + 1] - 1
        integral, spool = 0.0, 0.0
        if p[KI] != 0.0 and s.mode != VALVE:
            integral = _held(p, s, work, first, last)
        for k in range(first, last + 1):
            at = k - p[SKEW] / dt
            wanted = s.command[k] if prompt else delayed(s.command, first, last, at, p[DELAY] / dt)
            if s.mode == POSITION:
                here = s.position[k] if p[SKEW] == 0.0 else delayed(s.position, first, last, at, 0.0)
                error = wanted - here + p[BIAS]
            elif s.mode == TORQUE:
                error = wanted - s.effort[k] + p[OFFSET]
            else:
                error = wanted - p[NEUTRAL]
            driven = error + integral
            spool = driven if k == first else spool
            if s.mode == TORQUE:
                sequence[k], work.driven[k], work.summed[k] = wanted, spool, integral
            else:
                opening = follow(spool, driven, mean)
                sequence[k] = shape_opening(p, opening, s.time[k]) if bent else opening
            integral = integrate(integral, error, p[KI], p[WINDUP], dt)
            spool = follow(spool, driven, share)
    lay_out(work.command, s.first, work.opening)
    if s.mode == TORQUE:
        for w in range(s.first.shape[0]):
            work.spool[w] = work.driven[s.first[w]]
            work.integral[w] = work.summed[s.first[w]]


@njit(cache=True, nogil=True)
def _held(p: np.ndarray, s: Signals, work: Work, first: int, last: int) -> float:
    """What the integrator holds when a trial starts: what makes the openings add up to the change of torque.

    Logs begin in the middle of operation, so it is not zero, and a wrong start would last: until the integrator first
    stands at its limit, else through the whole trial.
    """
    soft = softened(p[K3], p[COMPLIANCE], p[DT])
    for k in range(first, last):
        at = k - p[SKEW] / p[DT]
        here = delayed(s.position, first, last, at, 0.0) if s.mode == POSITION else s.effort[k]
        error = delayed(s.command, first, last, at, p[DELAY] / p[DT]) - here
        work.sequence[k] = error + (p[BIAS] if s.mode == POSITION else p[OFFSET])
        work.stiff[k] = soft * stiffness(p[SLOPE], s.position[k] - p[MIDDLE])
        work.other[k] = work.stiff[k] * (p[K2] * (s.effort[k] - p[OFFSET]) + p[K3] * s.velocity[k])
    limit = 1.0 / max(p[WINDUP], 1e-300)
    low, high, start = -limit, limit, 0.0
    for _ in range(HELD_PASSES):
        missing, samples = _missing(p, s, work, first, last, start)
        if missing > 0.0:
            low = start
        else:
            high = start
        wanted = start + missing / max(p[K1] * samples, 1e-300)
        if wanted <= low or wanted >= high:  # the limit takes from what the start is worth
            wanted = 0.5 * (low + high)
        if abs(wanted - start) < HELD_CLOSE * abs(wanted):
            return wanted
        start = wanted
    return start


@njit(cache=True, nogil=True)
def _missing(p: np.ndarray, s: Signals, work: Work, first: int, last: int, start: float) -> tuple[float, int]:
    """Change of torque that an integrator which starts at `start` leaves open, N·m, and over how many samples.

    The spool's lag cancels in the sum.
    """
    integral, bent, change, end = start, shaped(p), 0.0, last
    bent_flow = p[ORIFICE] != 0.0 or p[DROOP] != 0.0 or p[K4] != 0.0
    limit = 1.0 / max(p[WINDUP], 1e-300)
    for k in range(first, last):
        error = work.sequence[k]
        opening = error + integral
        if bent:
            opening = shape_opening(p, opening, s.time[k])
        change -= work.other[k]
        if bent_flow:
            effort = s.effort[k] - p[OFFSET]
            flow = p[K1] * opening * orifice(opening, effort, p[ORIFICE], work.sagged[k])
            flow *= fed(opening, p[SLOPE], work.sagged[k])
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


@njit(cache=True, nogil=True)
def _motion(p: np.ndarray, s: Signals, work: Work) -> None:
    """Fill velocity and position as late as the torque is logged, what travel leaves of friction, and supply loss."""
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
    lay_out(work.speed, s.first, work.velocity)
    if grips(p):
        _slide(p, s, work)
    if p[DROOP] == 0.0:
        work.loss[:] = 0.0
        work.sagged[:] = 0.0
        return
    share = lag_share(p[RECOVERY], dt)
    for trial in range(s.bounds.shape[0] - 1):
        loss = p[DROOP] * s.demand[s.bounds[trial]]  # as if that had been drawn for long
        for k in range(s.bounds[trial], s.bounds[trial + 1]):
            loss = sag(loss, s.demand[k], p[DROOP], share)
            work.sagged[k] = loss
    lay_out(work.sagged, s.first, work.loss)


@njit(cache=True, nogil=True, inline="always")
def grips(p: np.ndarray) -> bool:
    """Whether dry friction is active."""
    return p[COULOMB] != 0.0 or p[STATIC] != 0.0 or p[LOAD] != 0.0


@njit(cache=True, nogil=True, inline="always")
def rubs(p: np.ndarray) -> bool:
    """Whether any friction is active."""
    return grips(p) or p[VISCOUS] != 0.0


@njit(cache=True, nogil=True, inline="always")
def shapes(p: np.ndarray) -> bool:
    """Whether the core differs from the base model's."""
    return p[ORIFICE] != 0.0 or p[DROOP] != 0.0 or p[SLOPE] != 0.0 or p[GAP] != 0.0 or p[COMPLIANCE] != 0.0


@njit(cache=True, nogil=True)
def _slide(p: np.ndarray, s: Signals, work: Work) -> None:
    """Share of the friction's direction that the travel of each sample leaves, and that of sticking at each speed."""
    for k in range(work.speed.shape[0]):
        work.slid[k] = kept_after(work.speed[k] * p[DT], p[PRESLIDING])
    lay_out(work.slid, s.first, work.kept)
    if p[STATIC] != 0.0:
        for k in range(work.speed.shape[0]):
            work.slow[k] = sticking(work.speed[k], p[STRIBECK], p[EXPONENT])
        lay_out(work.slow, s.first, work.sticking)


@njit(cache=True, nogil=True, inline="always")
def friction(p: np.ndarray, effort: float, velocity: float, turned: float, slow: float) -> float:
    """Torque lost between hydraulics and load cell, N·m; `slow` is the share of sticking at that speed."""
    lost = coulomb(turned, p[COULOMB], p[COULOMB_ASYMMETRY]) + viscous(velocity, p[VISCOUS])
    return lost + p[STATIC] * turned * slow + load_friction(turned, effort, p[LOAD])


@njit(cache=True, nogil=True, inline="always")
def unloaded(p: np.ndarray, effort: float, velocity: float, turned: float, slow: float) -> float:
    """Inner torque in front of the friction that leaves `effort`, N·m."""
    inner = effort + friction(p, 0.0, velocity, turned, slow)
    if p[LOAD] == 0.0:
        return inner
    return inner / max(1.0 - p[LOAD] * turned * np.sign(inner), LEAST_PASSED)


@njit(cache=True, nogil=True, inline="always")
def slid(p: np.ndarray, turned: float, change: float, inner: float, velocity: float, kept: float) -> float:
    """Direction of the friction one sample later, when the inner torque has changed by `change` to `inner`."""
    most = p[COULOMB] + p[STATIC] + p[LOAD] * abs(inner)
    if most <= 0.0:
        return turned
    return direction(stuck(turned, change / most), velocity, kept)


@njit(cache=True, nogil=True)
def _restart(p: np.ndarray, s: Signals, work: Work, anew: bool) -> None:
    """Inner torque at the start of each window from the logged one: the output side turned round.

    The way that friction points there hangs on the core so little that it is found `anew` with the inputs only.
    """
    half = 0.5 * p[GAP] * p[K3] / p[DT]
    if half > 0.0 or (anew and grips(p)):
        _follow(p, s, work, half)
    for w in range(s.first.shape[0]):
        effort, turned = s.target[0, w] - p[OFFSET], work.turned[w]
        inner = unloaded(p, effort, work.velocity[0, w], turned, work.sticking[0, w])
        if half > 0.0:
            lost = inner - effort
            inner = wound_up(work.other[s.first[w]] - lost, effort, half, p[CLEAR]) + lost
        work.state[w] = inner


@njit(cache=True, nogil=True)
def _follow(p: np.ndarray, s: Signals, work: Work, half: float) -> None:
    """Which way the friction points and where a slack chain stands, followed along with the logged torque: both hang on
    what went before a window."""
    opened, mean = work.command, mean_share(p[LAG], p[DT])
    if s.mode == TORQUE:
        opened = work.stiff
        for k in range(opened.shape[0]):
            driven = work.command[k] - s.effort[k] + p[OFFSET] + work.summed[k]
            opened[k] = shape_opening(p, follow(work.driven[k], driven, mean), s.time[k])
    for trial in range(s.bounds.shape[0] - 1):
        first, last = s.bounds[trial], s.bounds[trial + 1] - 1
        if half > 0.0:
            _take_up(p, s, work, opened, half, first, last)
        else:
            _turn(p, s, work, opened, first, last)
    for w in range(s.first.shape[0]):
        work.turned[w] = work.sequence[s.first[w]]


@njit(cache=True, nogil=True, error_model="numpy")
def _turn(p: np.ndarray, s: Signals, work: Work, opened: np.ndarray, first: int, last: int) -> None:
    """Direction of the friction before each sample of a trial."""
    coulomb_, static, load, offset = p[COULOMB], p[STATIC], p[LOAD], p[OFFSET]
    most, per = coulomb_ + static, 1.0 / max(coulomb_ + static, 1e-300)
    bent, uneven_, viscous_ = p[ORIFICE] != 0.0 or p[DROOP] != 0.0, p[COULOMB_ASYMMETRY], p[VISCOUS]
    k1, k2, k3, k4, slope = p[K1], p[K2], p[K3], p[K4], p[SLOPE]
    soft = softened(k3, p[COMPLIANCE], p[DT])
    turned = 0.0
    for k in range(first, last):
        work.sequence[k] = turned
        effort, velocity, u = s.effort[k] - offset, work.speed[k], opened[k]
        lost = coulomb(turned, coulomb_, uneven_) + viscous(velocity, viscous_) + static * turned * work.slow[k]
        inner = effort + lost
        if load != 0.0:
            inner /= max(1.0 - load * turned * np.sign(inner), LEAST_PASSED)
        passed = 1.0
        if bent:
            passed = orifice(u, inner, p[ORIFICE], work.sagged[k]) * fed(u, slope, work.sagged[k])
        change = k1 * u * passed - k2 * inner - k3 * velocity + k4 * impact(inner, u)
        change *= soft * stiffness(slope, s.position[k] - p[MIDDLE])
        if load != 0.0:
            most = coulomb_ + static + load * abs(inner + change)
            per = 1.0 / max(most, 1e-300)
        if most > 0.0:
            turned = direction(stuck(turned, change * per), velocity, work.slid[k])
    work.sequence[last] = turned


@njit(cache=True, nogil=True)
def _take_up(
    p: np.ndarray, s: Signals, work: Work, opened: np.ndarray, half: float, first: int, last: int
) -> None:
    """Where a slack chain stands before each sample of a trial, and the direction of the friction on its piston's side."""
    bent, rubbed, offset, clear = p[ORIFICE] != 0.0 or p[DROOP] != 0.0, rubs(p), p[OFFSET], p[CLEAR]
    k1, k2, k3, k4, slope, middle = p[K1], p[K2], p[K3], p[K4], p[SLOPE], p[MIDDLE]
    soft, turned, lost = softened(k3, p[COMPLIANCE], p[DT]), 0.0, 0.0
    wound = wound_up(0.0, s.effort[first], half, clear)
    for k in range(first, last):
        work.other[k], work.sequence[k] = wound, turned
        inner, velocity, u = transmitted(wound, half), work.speed[k], opened[k]
        effort = inner
        if rubbed:
            lost = friction(p, inner, velocity, turned, work.slow[k])
            effort = transmitted(wound - lost, half) + lost
        passed = 1.0
        if bent:
            passed = orifice(u, effort, p[ORIFICE], work.sagged[k]) * fed(u, slope, work.sagged[k])
        change = k1 * u * passed - k2 * effort - k3 * velocity + k4 * impact(effort, u)
        wound += soft * stiffness(slope, s.position[k] - middle) * change
        if rubbed:
            following = transmitted(wound, half)
            turned = slid(p, turned, following - inner, following, velocity, work.slid[k])
            lost = friction(p, following, work.speed[k + 1], turned, work.slow[k + 1])
        wound = wound_up(wound - lost, s.effort[k + 1] - offset, half, clear) + lost
    work.other[last], work.sequence[last] = wound, turned


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
    """Core with every effect, backlash without friction; the friction of the output side follows in `_rub`."""
    k1, k2, k3, k4, limit = p[K1], p[K2], p[K3], p[K4], p[LIMIT]
    inverse, slope, half = p[ORIFICE], p[SLOPE], 0.5 * p[GAP] * p[K3] / p[DT]
    soft, middle = softened(k3, p[COMPLIANCE], p[DT]), p[MIDDLE]
    state = work.state
    for k in range(s.steps):
        opening, velocity, offset, loss, row = work.opening[k], work.velocity[k], work.offset[k], work.loss[k], out[k]
        for w in range(state.shape[0]):
            u = opening[w]
            effort = transmitted(state[w], half)
            passed = orifice(u, effort, inverse, loss[w]) * fed(u, slope, loss[w])
            change = k1 * u * passed - k2 * effort - k3 * velocity[w]
            change += k4 * impact(effort, u)
            following = clip(state[w] + soft * stiffness(slope, offset[w] - middle) * change, limit)
            state[w] = following
            row[w] = transmitted(following, half)


@njit(cache=True, nogil=True)
def _slack(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Core and output where friction acts on the piston's side of a slack chain."""
    half, soft = 0.5 * p[GAP] * p[K3] / p[DT], softened(p[K3], p[COMPLIANCE], p[DT])
    for w in range(work.state.shape[0]):
        state, turned = work.state[w], work.turned[w]
        inner = transmitted(state, half)
        lost = friction(p, inner, work.velocity[0, w], turned, work.sticking[0, w])
        for k in range(s.steps):
            u, velocity = work.opening[k, w], work.velocity[k, w]
            effort = transmitted(state - lost, half) + lost
            passed = orifice(u, effort, p[ORIFICE], work.loss[k, w]) * fed(u, p[SLOPE], work.loss[k, w])
            change = p[K1] * u * passed - p[K2] * effort - p[K3] * velocity
            change += p[K4] * impact(effort, u)
            state = clip(state + soft * stiffness(p[SLOPE], work.offset[k, w] - p[MIDDLE]) * change, p[LIMIT])
            following = transmitted(state, half)
            turned = slid(p, turned, following - inner, following, velocity, work.kept[k, w])
            inner = following
            lost = friction(p, inner, work.velocity[k + 1, w], turned, work.sticking[k + 1, w])
            out[k, w] = transmitted(state - lost, half) + p[OFFSET]


@njit(cache=True, nogil=True)
def _rub(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Output side: friction and bias."""
    dry = grips(p)
    for w in range(out.shape[1]):
        turned, velocity = work.turned[w], work.velocity[0, w]
        before = unloaded(p, s.target[0, w] - p[OFFSET], velocity, turned, work.sticking[0, w])
        for k in range(s.steps):
            inner = out[k, w]
            if dry:
                turned = slid(p, turned, inner - before, inner, velocity, work.kept[k, w])
                before = inner
            velocity = work.velocity[k + 1, w]
            out[k, w] = inner - friction(p, inner, velocity, turned, work.sticking[k + 1, w]) + p[OFFSET]


@njit(cache=True, nogil=True)
def _torque_loop(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Core and output of torque mode: the force loop closes over the model's own torque, as the load cell feels it."""
    k1, k2, k3, limit, dt = p[K1], p[K2], p[K3], p[LIMIT], p[DT]
    half, soft = 0.5 * p[GAP] * k3 / dt, softened(k3, p[COMPLIANCE], dt)
    share, mean = lag_share(p[LAG], dt), mean_share(p[LAG], dt)
    for w in range(work.state.shape[0]):
        state, spool, integral = work.state[w], work.spool[w], work.integral[w]
        start, lost, rubbed = s.time[s.first[w]], 0.0, rubs(p)
        inner, turned = transmitted(state, half), work.turned[w]
        if rubbed:
            lost = friction(p, inner, work.velocity[0, w], turned, work.sticking[0, w])
        for k in range(s.steps):
            felt = transmitted(state - lost, half)
            effort = felt + lost
            error = work.opening[k, w] - felt
            driven = error + integral
            integral = integrate(integral, error, p[KI], p[WINDUP], dt)
            u = shape_opening(p, follow(spool, driven, mean), start + k * dt)
            spool = follow(spool, driven, share)
            passed = orifice(u, effort, p[ORIFICE], work.loss[k, w]) * fed(u, p[SLOPE], work.loss[k, w])
            change = k1 * u * passed - k2 * effort - k3 * work.velocity[k, w]
            state = clip(state + soft * stiffness(p[SLOPE], work.offset[k, w] - p[MIDDLE]) * change, limit)
            if rubbed:
                following = transmitted(state, half)
                turned = slid(p, turned, following - inner, following, work.velocity[k, w], work.kept[k, w])
                inner = following
                lost = friction(p, inner, work.velocity[k + 1, w], turned, work.sticking[k + 1, w])
            out[k, w] = transmitted(state - lost, half) + p[OFFSET]


@njit(cache=True, nogil=True)
def _speed(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Valve mode: the speed of a rate-controlled axis, less what leaks under load and what the transmission stretches."""
    for w in range(out.shape[1]):
        for k in range(s.steps):
            at = s.first[w] + k
            u = work.opening[k, w]
            flow = p[K1] * u * orifice(u, s.effort[at], p[ORIFICE], work.loss[k, w])
            out[k, w] = flow - p[K2] * s.effort[at] - p[COMPLIANCE] * s.rate[at]


@njit(cache=True, nogil=True)
def simulate(p: np.ndarray, s: Signals, work: Work, out: np.ndarray, inputs: int) -> None:
    """Predict the logged output of all windows.

    Args:
        p: (WIDTH,) row of parameters, see hqpipe.effects.layout.
        s, work: data and scratch.
        out: (steps, W), overwritten; row k is the prediction of `target` row k + 1.
        inputs: what to compute anew: CORE only, the command side too (COMMAND), or the motion as well (ALL).
    """
    if inputs >= ALL:
        _motion(p, s, work)
    if inputs >= COMMAND:
        _command_side(p, s, work)
    if s.mode == VALVE:
        _speed(p, s, work, out)
        return
    _restart(p, s, work, inputs >= COMMAND)
    if s.mode == TORQUE:
        _torque_loop(p, s, work, out)
    elif rubs(p) and p[GAP] != 0.0:
        _slack(p, s, work, out)
    elif shapes(p):
        _full(p, s, work, out)
        _rub(p, s, work, out)
    elif rubs(p):
        _plain(p, s, work, out, 0.0)
        _rub(p, s, work, out)
    else:
        _plain(p, s, work, out, p[OFFSET])
