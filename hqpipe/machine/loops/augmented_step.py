"""One sample of an actuator with effects, for a robot: what the training simulator steps.

The chain and its scalar functions are those of `hqpipe.machine.loops.augmented_windows`; here the states that a log
provides (past commands, spool, integrator, wound-up chain, sagging supply, speed of the piston) live in a row of memory per
joint. Position mode.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.machine.backlash import transmitted, wound_up
from hqpipe.machine.coulomb_friction import kept_after
from hqpipe.machine.integral_action import integrate
from hqpipe.machine.leakage_drift import leaked
from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    BIAS,
    CLEAR,
    COMPLIANCE,
    COMPRESSION,
    DELAY,
    DROOP,
    DT,
    EXCHANGE,
    EXPONENT,
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
    ORIFICE,
    PER_OPENING,
    PER_SPEED,
    PRESLIDING,
    PUMP,
    RECOVERY,
    SLOPE,
    SPRINGY,
    STATIC,
    STRIBECK,
    VALVE_DELAY,
    WINDUP,
)
from hqpipe.machine.loops.augmented_command import piston_lag, shape_opening
from hqpipe.machine.loops.augmented_output import friction, slid
from hqpipe.machine.loops.augmented_ring import RING_LENGTH, past
from hqpipe.machine.loops.laws import clip, impact
from hqpipe.machine.orifice_flow import balance, orifice
from hqpipe.machine.position_dependent_stiffness import displaced, exchanged, lean, stiffness
from hqpipe.machine.stribeck_friction import sticking
from hqpipe.machine.supply_droop import lacking, sag
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_lag import follow, lag_share, mean_share, swing

# columns of the memory; the rings of past commands and of what the controller put out are last
SAMPLES, SPOOL, INTEGRAL, WOUND, LOSS, MEAN, TURNED, PISTON, FED, RATE, RING = range(11)
SENT: Final = RING + RING_LENGTH  # second ring: what the controller put out
MEMORY: Final = SENT + RING_LENGTH


@njit(cache=True, nogil=True)
def wake(p: np.ndarray, memory: np.ndarray, torque: float, q_des: float, q: float, qd: float, demand: float) -> None:
    """States at the first sample, as if the joint had been held there."""
    half = 0.5 * p[GAP] * p[K3] / p[DT]
    lost = friction(p, torque, qd, 0.0, 0.0)
    inner = torque + lost
    memory[WOUND] = inner
    if half > 0.0:
        memory[WOUND] = wound_up(torque + half * np.sign(torque), torque, half, p[CLEAR]) + lost
    opened = q_des - q + p[BIAS]
    memory[LOSS] = max(p[DROOP] * lacking(demand, p[PUMP]), 0.0)
    memory[MEAN] = -memory[LOSS]
    memory[INTEGRAL] = 0.0
    if p[KI] != 0.0:
        limit = 1.0 / max(p[WINDUP], 1e-300)
        needed = p[K2] * (inner - balance(p[AREAS], p[ORIFICE])) + p[K3] * displaced(qd, memory[MEAN], p[COMPRESSION])
        passed = orifice(needed, inner, p[ORIFICE], memory[LOSS], memory[MEAN], lean(p[SLOPE]), p[AREAS])
        held = needed / max(p[K1] * passed, 1e-300) - opened
        memory[INTEGRAL] = min(max(held, -limit), limit)
    memory[SPOOL], memory[RATE] = opened + memory[INTEGRAL], 0.0
    memory[PISTON], memory[FED] = qd, shape_opening(p, memory[SPOOL], 0.0)


@njit(cache=True, nogil=True)
def _joint(p: np.ndarray, memory: np.ndarray, torque: float, q_des: float, q: float, qd: float, demand: float) -> float:
    """Torque of one joint after one sample, N·m."""
    now = int(memory[SAMPLES])
    memory[RING + now % RING_LENGTH] = q_des
    if now == 0:
        wake(p, memory, torque, q_des, q, qd, demand)
    dt = p[DT]
    error = past(memory, RING, now, p[DELAY] / dt) - q
    memory[SENT + now % RING_LENGTH] = error + memory[INTEGRAL] + p[BIAS]
    driven = past(memory, SENT, now, p[VALVE_DELAY] / dt)
    memory[INTEGRAL] = integrate(memory[INTEGRAL], error, p[KI], p[WINDUP], dt)
    behind, rate = memory[SPOOL] - driven, memory[RATE]
    yy, yv, vy, vv, my, mv = swing(p[LAG], p[SPRINGY], dt)
    u = shape_opening(p, driven + my * behind + mv * rate, now * dt)
    memory[SPOOL], memory[RATE] = driven + yy * behind + yv * rate, vy * behind + vv * rate
    relaxing = piston_lag(p)
    share, mean = lag_share(relaxing, dt), mean_share(relaxing, dt)
    opened, moved = u, qd
    u, qd = follow(memory[FED], opened, mean), follow(memory[PISTON], moved, mean)
    memory[FED], memory[PISTON] = follow(memory[FED], opened, share), follow(memory[PISTON], moved, share)
    memory[LOSS] = sag(memory[LOSS], lacking(demand, p[PUMP]), p[DROOP], lag_share(p[RECOVERY], dt))
    memory[MEAN] = exchanged(memory[MEAN], memory[LOSS], q_des - q, p[EXCHANGE], dt)
    half = 0.5 * p[GAP] * p[K3] / dt
    inner = transmitted(memory[WOUND], half)
    slow = sticking(qd, p[STRIBECK], p[EXPONENT]) if p[STATIC] != 0.0 else 0.0
    lost = friction(p, inner, qd, memory[TURNED], slow)
    effort = transmitted(memory[WOUND] - lost, half) + lost
    passed = orifice(u, effort, p[ORIFICE], memory[LOSS], memory[MEAN], lean(p[SLOPE]), p[AREAS])
    change = (
        p[K1] * u * passed
        - leaked(p[K2], p[LEAK_DRIFT], now * dt) * (effort - balance(p[AREAS], p[ORIFICE]))
        - p[K3] * displaced(qd, memory[MEAN], p[COMPRESSION])
    )
    change += p[K4] * impact(effort, u)
    change *= softened(p[K3], p[COMPLIANCE], dt) * stiffness(p[SLOPE], q - p[MIDDLE])
    memory[WOUND] = clip(memory[WOUND] + change, p[LIMIT])
    memory[SAMPLES] = now + 1.0
    following = transmitted(memory[WOUND], half)
    memory[TURNED] = slid(p, memory[TURNED], following - inner, following, qd, kept_after(qd * dt, p[PRESLIDING]))
    lost = friction(p, following, qd, memory[TURNED], slow)
    return clip(transmitted(memory[WOUND] - lost, half), p[LIMIT])


@njit(cache=True, nogil=True)
def augmented_row(
    parameters: np.ndarray, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> None:
    """Advance the joints of one robot by one sample, in place.

    Args:
        parameters: (J, WIDTH), see hqpipe.machine.layout.
        tau: (J,) joint torque, overwritten, N·m.
        memory: (J, MEMORY) states; all zero before the first sample.
        q_des, q, qd: (J,) rad, rad, rad/s.
    """
    demand = 0.0
    for j in range(tau.shape[0]):
        demand += parameters[j, PER_SPEED] * abs(qd[j]) + parameters[j, PER_OPENING] * abs(q_des[j] - q[j])
    for j in range(tau.shape[0]):
        tau[j] = _joint(parameters[j], memory[j], tau[j], q_des[j], q[j], qd[j], demand)
