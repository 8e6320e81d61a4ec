"""One sample of a valve-controlled cylinder pair with two chambers of oil, for one joint or a robot.

Reduced units: pressure in shares of supply minus return, flow as the joint speed that it feeds (rad/s), volume in shares
of the mean chamber. With the torque τ = T (p_a − p_b) − friction, the chambers obey

    (V_a / κ) ṗ_a = Q_a − q̇ − C (p_a − p_b),      V_a = 1 + ε (q − q_m)
    (V_b / κ) ṗ_b = Q_b + q̇ + C (p_a − p_b),      V_b = 1 − ε (q − q_m),      κ = K / 2T

(continuity with compressible oil: Merritt 1967, ch. 6; Jelali and Kroll 2003, ch. 4). Each chamber has a land to supply
and one to return with the openings of an underlapped spool at x (Merritt 1967, ch. 5), in rad of position error:

    Q_a = G [o(x) r(1 − p_a) − o(−x) r(p_a)],   Q_b = G [o(−x) r(1 − p_b) − o(x) r(p_b)],   o(z) = max(z + n, 0)

r(Δ) is √(2Δ), so that G is the no-load speed per rad. The spool follows the valve command q_des − q, cut where G x is
the speed at full stroke, through two equal lags. The joint torque carries the difference of the pressures, memory
their sum. No pressure falls below return: make-up valves keep the chambers full.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from hqpipe.actuators.loops.laws import clip

# columns of the parameters
TORQUE, STIFFNESS, FLOW, LAG, LEAK, NULL, CROSS, COULOMB, VISCOUS, SPEED, MIDDLE, SAMPLE_TIME, LIMIT = range(13)

AWAKE, SUM, DRIVER, SPOOL, SWEPT, LOST = range(6)  # columns of the memory
MEMORY: Final = 6

LAMINAR: Final = 0.003  # assumption: share of supply below which an orifice turns laminar; keeps the root smooth
SMALLEST: Final = 0.05  # assumption: share of the mean volume that hoses and ports leave at the end of the stroke
LEAST_DROP: Final = 0.05  # assumption: share of supply that a valve in steady motion keeps for itself
SLOW: Final = 0.05  # rad/s; assumption: below, dry friction grows with speed, since no log resolves its sign
SUBSTEPS: Final = 2  # 1, 2 and 4 fit walks of the reference plant equally well; 2 leaves a margin


@njit(cache=True, nogil=True, inline="always")
def root(drop: float) -> float:
    """√(2Δ) with its sign, laminar (linear) for |Δ| well below `LAMINAR`."""
    return drop * np.sqrt(2.0 / (abs(drop) + LAMINAR))


@njit(cache=True, nogil=True, inline="always")
def root_slope(drop: float) -> float:
    """dr/dΔ, never negative."""
    wide = abs(drop) + LAMINAR
    return (0.5 * abs(drop) + LAMINAR) / wide * np.sqrt(2.0 / wide)


@njit(cache=True, nogil=True, inline="always")
def relaxed(z: float) -> float:
    """(1 − e⁻ᶻ)/z for z ≥ 0, to third order and with its limits: the step of an exponential integrator."""
    return (1.0 + z / 6.0) / (1.0 + z * (2.0 / 3.0 + z / 6.0))


@njit(cache=True, nogil=True, inline="always")
def filled(p: float, feed: float, drain: float, swept: float, rate: float) -> float:
    """Pressure of a chamber after a substep without leakage; `rate` is κ h / V, the other flows are in rad/s."""
    flow = feed * root(1.0 - p) - drain * root(p) - swept
    slope = feed * root_slope(1.0 - p) + drain * root_slope(p)
    return max(p + rate * flow * relaxed(rate * slope), 0.0)


@njit(cache=True, nogil=True, inline="always")
def seeped(difference: float, leak: float, rate: float, other_rate: float) -> float:
    """Pressure that a chamber loses through the piston seal in half a substep, exact for the pair of chambers."""
    half = 0.5 * leak
    return half * rate * difference * relaxed(half * (rate + other_rate))


@njit(cache=True, nogil=True, inline="always")
def friction(p: np.ndarray, qd: float) -> float:
    """Torque that seals take between the oil and the load, N·m."""
    return p[VISCOUS] * qd + p[COULOMB] * qd / np.sqrt(qd * qd + SLOW * SLOW)


@njit(cache=True, nogil=True)
def wake(p: np.ndarray, memory: np.ndarray, torque: float, q: float, qd: float) -> None:
    """Memory at the first sample, as if the joint had moved steadily under its torque.

    Pressures balance around half of the supply. The valve feeds motion and leakage, wherever its command may be: a
    machine that has just been switched on has not followed it yet.
    """
    lost = friction(p, qd)
    difference = min(max((torque + lost) / p[TORQUE], -1.0), 1.0)
    needed = qd + p[LEAK] * difference
    drop = max(1.0 - (difference if needed > 0.0 else -difference), LEAST_DROP)
    opening = clip(needed / (p[FLOW] * np.sqrt(drop)), p[SPEED] / p[FLOW])
    memory[AWAKE], memory[SUM] = 1.0, 1.0
    memory[DRIVER], memory[SPOOL] = opening, opening
    memory[SWEPT], memory[LOST] = q, lost


@njit(cache=True, nogil=True)
def chamber_joint(p: np.ndarray, memory: np.ndarray, torque: float, q_des: float, q: float, qd: float) -> float:
    """Torque of one joint after one sample, N·m; `memory` (MEMORY,) is advanced in place."""
    if memory[AWAKE] == 0.0:
        wake(p, memory, torque, q, qd)
    dt = p[SAMPLE_TIME]
    h = dt / SUBSTEPS
    difference = (torque + memory[LOST]) / p[TORQUE]
    total = max(memory[SUM], abs(difference))
    a, b = 0.5 * (total + difference), 0.5 * (total - difference)
    # chambers follow the position itself: what a filtered velocity missed in this sample is made good in the next
    ahead = q + qd * dt
    speed = (ahead - memory[SWEPT]) / dt
    where = memory[SWEPT] - p[MIDDLE]
    command = clip(q_des - q, p[SPEED] / p[FLOW])
    z = 0.5 * h / p[LAG]
    kept = np.exp(-z)
    driver, spool = command - memory[DRIVER], command - memory[SPOOL]
    stiff = 0.5 * p[STIFFNESS] / p[TORQUE] * h
    for i in range(SUBSTEPS):
        spool = kept * (spool + z * driver)
        driver *= kept
        x = command - spool
        up, down = p[FLOW] * max(x + p[NULL], 0.0), p[FLOW] * max(p[NULL] - x, 0.0)
        bend = p[CROSS] * (where + speed * h * (i + 0.5))
        rate_a, rate_b = stiff / max(1.0 + bend, SMALLEST), stiff / max(1.0 - bend, SMALLEST)
        out = seeped(a - b, p[LEAK], rate_a, rate_b)
        into = seeped(a - b, p[LEAK], rate_b, rate_a)
        a, b = filled(a - out, up, down, speed, rate_a), filled(b + into, down, up, -speed, rate_b)
        out = seeped(a - b, p[LEAK], rate_a, rate_b)
        into = seeped(a - b, p[LEAK], rate_b, rate_a)
        a, b = a - out, b + into
        spool = kept * (spool + z * driver)
        driver *= kept
    memory[SUM] = a + b
    memory[DRIVER], memory[SPOOL] = command - driver, command - spool
    memory[SWEPT], memory[LOST] = ahead, friction(p, qd)
    return clip(p[TORQUE] * (a - b) - memory[LOST], p[LIMIT])


@njit(cache=True, nogil=True)
def chamber_row(
    parameters: np.ndarray, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray
) -> None:
    """Advance the joints of one robot by one sample, in place.

    Args:
        parameters: (J, 13), the columns above.
        tau: (J,) joint torque, overwritten, N·m.
        memory: (J, MEMORY) states; all zero before the first sample.
        q_des, q, qd: (J,) rad, rad, rad/s.
    """
    for j in range(tau.shape[0]):
        tau[j] = chamber_joint(parameters[j], memory[j], tau[j], q_des[j], q[j], qd[j])
