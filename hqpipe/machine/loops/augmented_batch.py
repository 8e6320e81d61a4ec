"""Many robots with effects at once: the chain of `hqpipe.machine.loops.augmented_step`, one plain loop per link.

The joints of all robots lie end to end. A block of them goes through the links one after the other, so that the compiler
works on several joints per instruction; a link that no joint has is left out. What a row of parameters gives once and for
all (shares of a sample, factors, sums) is computed beforehand by `prepare`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.backlash import transmitted
from hqpipe.machine.coulomb_friction import coulomb, direction, kept_after, stuck
from hqpipe.machine.integral_action import integrate
from hqpipe.machine.leakage_drift import leaked
from hqpipe.machine.load_dependent_friction import load_friction
from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    BAND,
    BIAS,
    COMPRESSION,
    COULOMB,
    COULOMB_ASYMMETRY,
    DROOP,
    DT,
    EXCHANGE,
    EXPONENT,
    K1,
    K2,
    K3,
    K4,
    KI,
    LEAK_DRIFT,
    LIMIT,
    LOAD,
    MIDDLE,
    ORIFICE,
    PER_OPENING,
    PER_SPEED,
    PRESLIDING,
    PUMP,
    ROUNDING,
    SLOPE,
    STATIC,
    STRIBECK,
    VISCOUS,
    WINDUP,
)
from hqpipe.machine.loops.augmented_links import (
    ALIKE,
    BIASED,
    DEAD,
    DELAYED,
    DRIFTING,
    EVEN,
    FLOWING,
    HALF,
    INTEGRATED,
    LAGGED,
    LEAKING,
    LEAN,
    MEAN_RELAXED,
    MEAN_SHARE,
    ONE_SIDED,
    ONE_WAY,
    PART,
    PER_S,
    RECOVERED,
    RELAXED,
    RELAXING,
    RUBBING,
    SAGGING,
    SATURATED,
    SENT_ALIKE,
    SENT_LATE,
    SENT_PART,
    SENT_WHOLE,
    SHARE,
    SLACK,
    SOFT,
    STIFFENED,
    SWING,
    SWINGING,
    TOP,
    WHOLE,
)
from hqpipe.machine.loops.augmented_reset import counts, wake_block
from hqpipe.machine.loops.augmented_ring import delayed_block
from hqpipe.machine.loops.augmented_step import (
    FED,
    INTEGRAL,
    LOSS,
    MEAN,
    PISTON,
    RATE,
    RING,
    SAMPLES,
    SENT,
    SPOOL,
    TURNED,
    WOUND,
)
from hqpipe.machine.loops.laws import clip, impact
from hqpipe.machine.orifice_flow import orifice
from hqpipe.machine.position_dependent_stiffness import displaced, exchanged, stiffness
from hqpipe.machine.stribeck_friction import sticking
from hqpipe.machine.supply_droop import lacking, sag
from hqpipe.machine.valve_deadband import deadband
from hqpipe.machine.valve_lag import follow
from hqpipe.machine.viscous_friction import viscous


@njit(cache=True, nogil=True, inline="always")
def _command(
    p: np.ndarray,
    d: np.ndarray,
    links: np.ndarray,
    m: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    u: np.ndarray,
    start: int,
    size: int,
    in_step: bool,
) -> None:
    """Error, integrator, spool and what shapes the opening, into `u` (B,)."""
    for i in range(size):
        u[i] = q_des[start + i]
    if links[DELAYED]:
        delayed_block(d, m, SAMPLES, RING, WHOLE, PART, links[ALIKE] and in_step, u, start, size)
    for i in range(size):
        u[i] -= q[start + i]
    if links[INTEGRATED]:
        for i in range(size):
            error, held = u[i], m[INTEGRAL, start + i]
            u[i] = error + held
            m[INTEGRAL, start + i] = integrate(held, error, p[KI, i], p[WINDUP, i], p[DT, i])
    if links[BIASED]:
        for i in range(size):
            u[i] += p[BIAS, i]
    if links[SENT_LATE]:
        delayed_block(d, m, SAMPLES, SENT, SENT_WHOLE, SENT_PART, links[SENT_ALIKE] and in_step, u, start, size)
    if links[LAGGED] and links[SWINGING]:
        for i in range(size):
            driven, k = u[i], start + i
            behind, rate = m[SPOOL, k] - driven, m[RATE, k]
            u[i] = driven + d[SWING + 4, i] * behind + d[SWING + 5, i] * rate
            m[SPOOL, k] = driven + d[SWING, i] * behind + d[SWING + 1, i] * rate
            m[RATE, k] = d[SWING + 2, i] * behind + d[SWING + 3, i] * rate
    elif links[LAGGED]:
        for i in range(size):
            driven, spool = u[i], m[SPOOL, start + i]
            u[i] = follow(spool, driven, d[MEAN_SHARE, i])
            m[SPOOL, start + i] = follow(spool, driven, d[SHARE, i])
    if links[DEAD]:
        for i in range(size):
            u[i] = deadband(u[i], p[BAND, i], p[ROUNDING, i])
    if links[SATURATED]:
        for i in range(size):
            u[i] = clip(u[i], d[TOP, i])
    if links[ONE_SIDED]:
        for i in range(size):
            u[i] += d[ONE_WAY, i] * abs(u[i])
    if links[DRIFTING]:
        for i in range(size):
            u[i] *= max(1.0 + d[PER_S, i] * m[SAMPLES, start + i], 0.0)


@njit(cache=True, nogil=True, inline="always")
def _relaxed(
    d: np.ndarray, m: np.ndarray, qd: np.ndarray, u: np.ndarray, speed: np.ndarray, start: int, size: int
) -> None:
    """The opening `u` (B,) and the `speed` (n,) as they drive a joint whose piston lags behind."""
    for i in range(size):
        k = start + i
        piston, fed, opened = m[PISTON, k], m[FED, k], u[i]
        speed[k], u[i] = follow(piston, qd[k], d[MEAN_RELAXED, i]), follow(fed, opened, d[MEAN_RELAXED, i])
        m[PISTON, k], m[FED, k] = follow(piston, qd[k], d[RELAXED, i]), follow(fed, opened, d[RELAXED, i])


@njit(cache=True, nogil=True, inline="always")
def _supply(
    p: np.ndarray,
    d: np.ndarray,
    links: np.ndarray,
    m: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    joints: int,
    flow: np.ndarray,
    start: int,
    size: int,
) -> None:
    """Sagging of the supply under the flow of each robot's joints; `flow` (B,) is scratch."""
    for i in range(size):
        k = start + i
        flow[i] = p[PER_SPEED, i] * abs(qd[k]) + p[PER_OPENING, i] * abs(q_des[k] - q[k])
    fours = joints - joints % 4
    for first in range(0, size, joints):
        a, b, c, e = 0.0, 0.0, 0.0, 0.0  # four sums at a time: one alone would wait for each of its additions
        for i in range(first, first + fours, 4):
            a, b, c, e = a + flow[i], b + flow[i + 1], c + flow[i + 2], e + flow[i + 3]
        for i in range(first + fours, first + joints):
            a += flow[i]
        demand = (a + b) + (c + e)
        for i in range(first, first + joints):
            flow[i] = demand
    for i in range(size):
        m[LOSS, start + i] = sag(m[LOSS, start + i], lacking(flow[i], p[PUMP, i]), p[DROOP, i], d[RECOVERED, i])
    if links[STIFFENED]:
        for i in range(size):
            k = start + i
            opened = q_des[k] - q[k]
            m[MEAN, k] = exchanged(m[MEAN, k], m[LOSS, k], opened, p[EXCHANGE, i], p[DT, i])


@njit(cache=True, nogil=True, inline="always")
def _friction(p: np.ndarray, i: int, inner: float, speed: float, turned: float, slow: float) -> float:
    """`hqpipe.machine.loops.augmented_output.friction` of column i."""
    lost = coulomb(turned, p[COULOMB, i], p[COULOMB_ASYMMETRY, i]) + viscous(speed, p[VISCOUS, i])
    return lost + p[STATIC, i] * turned * slow + load_friction(turned, inner, p[LOAD, i])


@njit(cache=True, nogil=True, inline="always")
def _rubbed(
    p: np.ndarray,
    d: np.ndarray,
    m: np.ndarray,
    qd: np.ndarray,
    lost: np.ndarray,
    slow: np.ndarray,
    start: int,
    size: int,
) -> None:
    """Share of sticking and friction torque before the sample, N·m, into `slow` and `lost` (B,)."""
    for i in range(size):
        k = start + i
        slow[i] = sticking(qd[k], p[STRIBECK, i], p[EXPONENT, i]) if p[STATIC, i] != 0.0 else 0.0
        lost[i] = _friction(p, i, transmitted(m[WOUND, k], d[HALF, i]), qd[k], m[TURNED, k], slow[i])


@njit(cache=True, nogil=True, inline="always")
def _core(
    p: np.ndarray,
    d: np.ndarray,
    links: np.ndarray,
    m: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    u: np.ndarray,
    lost: np.ndarray,
    leak: np.ndarray,
    change: np.ndarray,
    start: int,
    size: int,
) -> None:
    """Change of the wound-up torque over the sample, N·m, into `change` (B,)."""
    if links[SLACK]:
        for i in range(size):
            change[i] = transmitted(m[WOUND, start + i] - lost[i], d[HALF, i]) + lost[i]
    else:
        for i in range(size):
            change[i] = m[WOUND, start + i]
    for i in range(size):
        leak[i] = p[K2, i]
    if links[LEAKING]:
        for i in range(size):
            leak[i] = leaked(leak[i], p[LEAK_DRIFT, i], m[SAMPLES, start + i] * p[DT, i])
    if links[FLOWING]:
        for i in range(size):
            effort, opening = change[i], u[i]
            loss, mean = m[LOSS, start + i], m[MEAN, start + i]
            u[i] = opening * orifice(opening, effort, p[ORIFICE, i], loss, mean, d[LEAN, i], p[AREAS, i])
            change[i] = p[K4, i] * impact(effort, opening) - leak[i] * (effort - d[EVEN, i])
    else:
        for i in range(size):
            effort = change[i]
            change[i] = p[K4, i] * impact(effort, u[i]) - leak[i] * effort
    if links[STIFFENED]:
        for i in range(size):
            k = start + i
            stiff = d[SOFT, i] * stiffness(p[SLOPE, i], q[k] - p[MIDDLE, i])
            speed = displaced(qd[k], m[MEAN, k], p[COMPRESSION, i])
            change[i] = stiff * (change[i] + p[K1, i] * u[i] - p[K3, i] * speed)
    else:
        for i in range(size):
            change[i] = d[SOFT, i] * (change[i] + p[K1, i] * u[i] - p[K3, i] * qd[start + i])


@njit(cache=True, nogil=True, inline="always")
def _turned(
    p: np.ndarray,
    d: np.ndarray,
    m: np.ndarray,
    qd: np.ndarray,
    lost: np.ndarray,
    slow: np.ndarray,
    before: np.ndarray,
    start: int,
    size: int,
) -> None:
    """Direction of the friction and its torque after the sample; `before` (B,) is the wound-up torque before it."""
    for i in range(size):
        k = start + i
        inner, following, turned = (
            transmitted(before[i], d[HALF, i]),
            transmitted(m[WOUND, k], d[HALF, i]),
            m[TURNED, k],
        )
        most = p[COULOMB, i] + p[STATIC, i] + p[LOAD, i] * abs(following)
        if most > 0.0:
            kept = kept_after(qd[k] * p[DT, i], p[PRESLIDING, i])
            turned = direction(stuck(turned, (following - inner) / most), qd[k], kept)
            m[TURNED, k] = turned
        lost[i] = _friction(p, i, following, qd[k], turned, slow[i])


@njit(cache=True, nogil=True)
def augmented_batch(
    p: np.ndarray,
    d: np.ndarray,
    links: np.ndarray,
    tau: np.ndarray,
    m: np.ndarray,
    q_des: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    joints: int,
) -> None:
    """Advance robots by one sample, in place.

    Args:
        p, d, links: of `prepare`.
        tau: (n,) torque of the joints of all robots end to end, overwritten, N·m.
        m: (MEMORY, n) as in `augmented_row`, all zero for a robot before its first sample.
        q_des, q, qd: (n,) rad, rad, rad/s.
        joints: J of a robot.
    """
    block = p.shape[1]
    u, lost, slow, change, before = np.empty(block), np.zeros(block), np.zeros(block), np.empty(block), np.empty(block)
    leak, speed = np.empty(block), np.empty_like(qd) if links[RELAXING] else qd
    for start in range(0, tau.shape[0], block):
        size = min(block, tau.shape[0] - start)
        asleep, in_step = counts(m, start, size)
        if asleep:
            wake_block(p, m, tau, q_des, q, qd, joints, start, size)
        _command(p, d, links, m, q_des, q, u, start, size, in_step)
        if links[RELAXING]:
            _relaxed(d, m, qd, u, speed, start, size)
        if links[SAGGING]:
            _supply(p, d, links, m, q_des, q, qd, joints, change, start, size)
        if links[RUBBING]:
            _rubbed(p, d, m, speed, lost, slow, start, size)
        _core(p, d, links, m, q, speed, u, lost, leak, change, start, size)
        if links[RUBBING]:
            for i in range(size):
                before[i] = m[WOUND, start + i]
        for i in range(size):
            wound = clip(m[WOUND, start + i] + change[i], p[LIMIT, i])
            m[WOUND, start + i] = wound
            tau[start + i] = wound
        if (
            asleep or links[DELAYED] or links[SENT_LATE] or links[DRIFTING] or links[LEAKING]
        ):  # else it only matters that it is no longer 0
            for i in range(size):
                m[SAMPLES, start + i] += 1.0
        if links[RUBBING]:
            _turned(p, d, m, speed, lost, slow, before, start, size)
        if links[RUBBING] or links[SLACK]:
            for i in range(size):
                tau[start + i] = clip(transmitted(m[WOUND, start + i] - lost[i], d[HALF, i]), p[LIMIT, i])
