"""The output side of an actuator with effects: friction in front of the load cell, and slack."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.backlash import transmitted, wound_up
from hqpipe.machine.command_delay import delayed
from hqpipe.machine.coulomb_friction import coulomb, direction, kept_after, stuck
from hqpipe.machine.leakage_drift import leaked
from hqpipe.machine.load_dependent_friction import load_friction
from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    CLEAR,
    COMPLIANCE,
    COMPRESSION,
    COULOMB,
    COULOMB_ASYMMETRY,
    DROOP,
    DT,
    EXPONENT,
    K1,
    K2,
    K3,
    K4,
    LAG,
    LEAK_DRIFT,
    LEAST_PASSED,
    LOAD,
    MIDDLE,
    OFFSET,
    ORIFICE,
    PRESLIDING,
    SKEW,
    SLOPE,
    SPEED_LATE,
    STATIC,
    STRIBECK,
    TORQUE,
    VISCOUS,
)
from hqpipe.machine.loops.augmented_command import piston_lag, shape_opening
from hqpipe.machine.loops.augmented_signals import Signals, Work, lag_behind, lay_out
from hqpipe.machine.loops.laws import impact
from hqpipe.machine.orifice_flow import balance, orifice
from hqpipe.machine.position_dependent_stiffness import displaced, lean, stiffness
from hqpipe.machine.stribeck_friction import sticking
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_lag import follow, mean_share
from hqpipe.machine.viscous_friction import viscous


@njit(cache=True, nogil=True, inline="always")
def grips(p: np.ndarray) -> bool:
    """Whether dry friction is active."""
    return p[COULOMB] != 0.0 or p[STATIC] != 0.0 or p[LOAD] != 0.0


@njit(cache=True, nogil=True, inline="always")
def rubs(p: np.ndarray) -> bool:
    """Whether any friction is active."""
    return grips(p) or p[VISCOUS] != 0.0


@njit(cache=True, nogil=True)
def move(p: np.ndarray, s: Signals, work: Work) -> None:
    """Speed of the piston at the instant of each sample's torque."""
    late = p[SKEW] / p[DT] + p[SPEED_LATE]
    for trial in range(s.bounds.shape[0] - 1):
        first, last = s.bounds[trial], s.bounds[trial + 1] - 1
        for k in range(first, last + 1):
            work.moving[k] = s.velocity[k] if late == 0.0 else delayed(s.velocity, first, last, float(k), late)
    lag_behind(work.moving, s.bounds, piston_lag(p), p[DT])
    lay_out(work.moving, s.first, work.sliding)


@njit(cache=True, nogil=True)
def slide(p: np.ndarray, s: Signals, work: Work) -> None:
    """Share of friction's direction that the travel to the next sample leaves, and share of sticking."""
    if grips(p):
        for k in range(work.speed.shape[0]):
            work.slid[k] = kept_after(work.speed[k] * p[DT], p[PRESLIDING])
        lay_out(work.slid, s.first, work.kept)
    if p[STATIC] != 0.0:
        for k in range(work.moving.shape[0]):
            work.slow[k] = sticking(work.moving[k], p[STRIBECK], p[EXPONENT])
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
def follow_along(p: np.ndarray, s: Signals, work: Work, half: float) -> None:
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


@njit(cache=True, nogil=True)
def _turn(p: np.ndarray, s: Signals, work: Work, opened: np.ndarray, first: int, last: int) -> None:
    """Direction of the friction before each sample of a trial."""
    bent, offset, middle, slope = p[ORIFICE] != 0.0 or p[DROOP] != 0.0, p[OFFSET], p[MIDDLE], p[SLOPE]
    k1, k2, k3, k4, soft, turned = p[K1], p[K2], p[K3], p[K4], softened(p[K3], p[COMPLIANCE], p[DT]), 0.0
    even = balance(p[AREAS], p[ORIFICE])
    for k in range(first, last):
        work.sequence[k] = turned
        velocity, u = work.speed[k], opened[k]
        inner = unloaded(p, s.effort[k] - offset, work.moving[k], turned, work.slow[k])
        passed = 1.0
        if bent:
            passed = orifice(u, inner, p[ORIFICE], work.sagged[k], work.middling[k], lean(slope), p[AREAS])
        leak = leaked(k2, p[LEAK_DRIFT], s.time[k])
        change = k1 * u * passed - leak * (inner - even) + k4 * impact(inner, u)
        change -= k3 * displaced(velocity, work.middling[k], p[COMPRESSION])
        change *= soft * stiffness(slope, s.position[k] - middle)
        turned = slid(p, turned, change, inner + change, velocity, work.slid[k])
    work.sequence[last] = turned


@njit(cache=True, nogil=True)
def _take_up(p: np.ndarray, s: Signals, work: Work, opened: np.ndarray, half: float, first: int, last: int) -> None:
    """Where a slack chain stands before each sample of a trial, and the direction of the friction on its piston's side."""
    bent, rubbed, offset, clear = p[ORIFICE] != 0.0 or p[DROOP] != 0.0, rubs(p), p[OFFSET], p[CLEAR]
    k1, k2, k3, k4, slope, middle = p[K1], p[K2], p[K3], p[K4], p[SLOPE], p[MIDDLE]
    even = balance(p[AREAS], p[ORIFICE])
    soft, turned, lost = softened(k3, p[COMPLIANCE], p[DT]), 0.0, 0.0
    wound = wound_up(0.0, s.effort[first], half, clear)
    for k in range(first, last):
        work.other[k], work.sequence[k] = wound, turned
        inner, velocity, u = transmitted(wound, half), work.speed[k], opened[k]
        effort = inner
        if rubbed:
            lost = friction(p, inner, work.moving[k], turned, work.slow[k])
            effort = transmitted(wound - lost, half) + lost
        passed = 1.0
        if bent:
            passed = orifice(u, effort, p[ORIFICE], work.sagged[k], work.middling[k], lean(slope), p[AREAS])
        leak = leaked(k2, p[LEAK_DRIFT], s.time[k])
        change = k1 * u * passed - leak * (effort - even) + k4 * impact(effort, u)
        change -= k3 * displaced(velocity, work.middling[k], p[COMPRESSION])
        wound += soft * stiffness(slope, s.position[k] - middle) * change
        if rubbed:
            following = transmitted(wound, half)
            turned = slid(p, turned, following - inner, following, velocity, work.slid[k])
            lost = friction(p, following, work.moving[k + 1], turned, work.slow[k + 1])
        wound = wound_up(wound - lost, s.effort[k + 1] - offset, half, clear) + lost
    work.other[last], work.sequence[last] = wound, turned


@njit(cache=True, nogil=True)
def rub(p: np.ndarray, s: Signals, work: Work, out: np.ndarray) -> None:
    """Output side: friction and bias."""
    if not grips(p):
        for k in range(s.steps):
            for w in range(out.shape[1]):
                out[k, w] = out[k, w] - viscous(work.sliding[k + 1, w], p[VISCOUS]) + p[OFFSET]
        return
    for w in range(out.shape[1]):
        turned = work.turned[w]
        before = unloaded(p, s.target[0, w] - p[OFFSET], work.sliding[0, w], turned, work.sticking[0, w])
        for k in range(s.steps):
            inner = out[k, w]
            turned = slid(p, turned, inner - before, inner, work.velocity[k, w], work.kept[k, w])
            before = inner
            lost = friction(p, inner, work.sliding[k + 1, w], turned, work.sticking[k + 1, w])
            out[k, w] = inner - lost + p[OFFSET]
