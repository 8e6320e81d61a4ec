"""Compiled hydraulics of one legged joint: spool, four lands, two chambers, a piston whose seals stick, linkage or sprocket.

Flow through a land is K w √Δp with the uncovered width w (Merritt 1967, ch. 3 and 5); a chamber obeys dp/dt = β/V (Q − A v);
the spool is a second-order lag with a highest speed (Jelali and Kroll 2003). Seals stick as in Karnopp 1985.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

STEP: Final = 1.0e-4  # s
FIELDS = (
    (
        "area_a area_b stroke dead_a dead_b modulus "  # m², m², m, m³, m³, Pa
        "leakage leakage_drift "  # m³/(s·Pa) between the chambers, 1/s of its exponential growth
        "piston_mass coulomb stribeck stribeck_speed viscous load_friction "  # kg, N, N, m/s, N·s/m, 1
        "link_stiffness link_damping play "  # N/m, N·s/m, m of lost motion between piston and joint
        "radius side_a side_b phase middle "  # m of a sprocket, or both sides and angle of a linkage; rad at half stroke
        "flow natural_hz damping slew overlap corner limit "  # m³/(s·√Pa) a land, Hz, 1, 1/s, opening, opening, opening
        "asymmetry gain_drift null valve_delay_s "  # 1, 1/s, opening, s
        "stiction hysteresis air cold cold_until hunting hunting_hz "  # opening, opening, Pa, 1, s, 1, Hz
        "gain integral integral_limit history command_delay_s crosstalk lost_share "  # 1/rad, 1/s, opening, opening, s, 1, 1
        "ripple_angle "  # rad, amplitude of an eccentric encoder's error
        "torque_bias skew_s unsigned stale_share"  # N·m, s, 0 or 1, 1: of the torque channel
    ).split()
)
JOINT = np.dtype([(name, np.float64) for name in FIELDS], align=True)
"""One joint's hydraulics, valve, position loop and torque channel."""
SUPPLY = np.dtype([(n, np.float64) for n in "pressure tank slope capacity pump ripple ripple_hz".split()], align=True)
"""Set pressure and tank, Pa; m³/(s·Pa) by which the pump answers a fall; m³/Pa of accumulator and lines; m³/s; 1; Hz."""

PA, PB, SPOOL, SPOOL_SPEED, PISTON, PISTON_SPEED, HELD, SLACK = range(8)
"""Columns of a joint's state: Pa, Pa, opening, 1/s, m, m/s, where a sticking spool was last sent, hysteresis."""
LAMINAR: Final = 1.0e5  # Pa, below which a land is laminar, so that its slope stays finite; assumption
EMPTY: Final = 1.0e3  # Pa, the least that oil bears before it opens a cavity


@njit(cache=True, nogil=True, error_model="numpy")
def root(drop: float) -> float:
    """√Δp with its sign, √Pa; a straight line where the flow is laminar."""
    size = abs(drop)
    value = np.sqrt(size) if size > LAMINAR else size / np.sqrt(LAMINAR)
    return value if drop > 0.0 else -value


@njit(cache=True, nogil=True, error_model="numpy")
def uncovered(shift: float, corner: float) -> float:
    """Width of a land that a spool uncovers, opening; worn edges of radius `corner` begin to leak before."""
    return 0.5 * (shift + np.sqrt(shift * shift + corner * corner))


@njit(cache=True, nogil=True, error_model="numpy")
def lever(joint, angle: float) -> tuple[float, float]:
    """Where the joint holds the piston, m from half stroke, and the moment arm dx/dq, m."""
    if joint.side_a <= 0.0:
        return joint.radius * (angle - joint.middle), joint.radius
    a, b = joint.side_a, joint.side_b
    zero = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(joint.phase))
    turned = joint.phase + angle - joint.middle
    length = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(turned))
    return length - zero, a * b * np.sin(turned) / length


@njit(cache=True, nogil=True, error_model="numpy")
def drive_spool(joint, state, command: float, time: float) -> None:
    """Advance the spool by a step towards a command, both in shares of the full opening."""
    state[SLACK] = max(min(state[SLACK], command + joint.hysteresis), command - joint.hysteresis)
    goal = state[SLACK] + joint.null
    gain = 1.0 + joint.gain_drift * time + joint.hunting * np.sin(2.0 * np.pi * joint.hunting_hz * time)
    if time < joint.cold_until:
        gain *= 1.0 - joint.cold
    goal = goal * max(gain, 0.0) * (1.0 + joint.asymmetry if goal > 0.0 else 1.0 - joint.asymmetry)
    if abs(goal - state[HELD]) > joint.stiction:
        state[HELD] = goal
    goal = min(max(state[HELD], -joint.limit), joint.limit)
    rate = 2.0 * np.pi * joint.natural_hz
    speed = state[SPOOL_SPEED] + STEP * rate * rate * (goal - state[SPOOL])
    speed /= 1.0 + STEP * 2.0 * joint.damping * rate
    state[SPOOL_SPEED] = min(max(speed, -joint.slew), joint.slew)
    state[SPOOL] += STEP * state[SPOOL_SPEED]
    if abs(state[SPOOL]) > joint.limit:
        state[SPOOL] = min(max(state[SPOOL], -joint.limit), joint.limit)
        state[SPOOL_SPEED] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def flows(joint, state, supply: float, tank: float) -> tuple[float, float, float]:
    """Oil into chamber a, into chamber b, and out of the supply, m³/s."""
    s, k = state[SPOOL], joint.flow
    out, back = uncovered(s - joint.overlap, joint.corner), uncovered(-s - joint.overlap, joint.corner)
    from_supply_a, to_tank_a = k * out * root(supply - state[PA]), k * back * root(state[PA] - tank)
    from_supply_b, to_tank_b = k * back * root(supply - state[PB]), k * out * root(state[PB] - tank)
    return from_supply_a - to_tank_a, from_supply_b - to_tank_b, from_supply_a + from_supply_b


@njit(cache=True, nogil=True, error_model="numpy")
def modulus(joint, pressure: float) -> float:
    """Of oil with free air in a soft hose: less where the pressure is low; Pa (form of Jelali and Kroll 2003)."""
    return joint.modulus * pressure / (pressure + joint.air)


@njit(cache=True, nogil=True, error_model="numpy")
def link_force(joint, state, place: float, speed: float) -> float:
    """Force of the piston on the joint through rod, pins or chain, N.

    Args:
        place, speed: of the joint, as travel of the piston, m, m/s.
    """
    stretch = state[PISTON] - place
    half = 0.5 * joint.play
    if stretch > half:
        return max(joint.link_stiffness * (stretch - half) + joint.link_damping * (state[PISTON_SPEED] - speed), 0.0)
    if stretch < -half:
        return min(joint.link_stiffness * (stretch + half) + joint.link_damping * (state[PISTON_SPEED] - speed), 0.0)
    if joint.play == 0.0:
        return joint.link_damping * (state[PISTON_SPEED] - speed)
    return 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def advance(joint, state, supply: float, tank: float, force: float, time: float) -> float:
    """Advance chambers and piston by a step; the oil taken from the supply, m³/s.

    Args:
        force: of the piston on the joint, N. time: s since the start of the record.
    """
    into_a, into_b, drawn = flows(joint, state, supply, tank)
    leak = joint.leakage * (state[PA] - state[PB])
    if joint.leakage_drift != 0.0 and time > 0.0:
        leak *= np.exp(joint.leakage_drift * time)
    v = state[PISTON_SPEED]
    volume_a = joint.dead_a + joint.area_a * (0.5 * joint.stroke + state[PISTON])
    volume_b = joint.dead_b + joint.area_b * (0.5 * joint.stroke - state[PISTON])
    rate_a = modulus(joint, state[PA]) / max(volume_a, 0.2 * joint.dead_a)
    rate_b = modulus(joint, state[PB]) / max(volume_b, 0.2 * joint.dead_b)
    state[PA] = max(state[PA] + STEP * rate_a * (into_a - leak - joint.area_a * v), EMPTY)
    state[PB] = max(state[PB] + STEP * rate_b * (into_b + leak + joint.area_b * v), EMPTY)
    push = state[PA] * joint.area_a - state[PB] * joint.area_b - force
    free = (v + STEP * push / joint.piston_mass) / (1.0 + STEP * joint.viscous / joint.piston_mass)
    dry = joint.coulomb + joint.load_friction * abs(force)
    if joint.stribeck > 0.0 and abs(free) < 4.0 * joint.stribeck_speed:  # beyond it less than 1e-6 is left
        dry += joint.stribeck * np.exp(-((free / joint.stribeck_speed) ** 2))
    stop = STEP * dry / joint.piston_mass
    state[PISTON_SPEED] = 0.0 if abs(free) <= stop else free - np.sign(free) * stop
    state[PISTON] += STEP * state[PISTON_SPEED]
    return drawn


@njit(cache=True, nogil=True, error_model="numpy")
def supplied(supply, pressure: float, drawn: float, time: float) -> float:
    """Pressure of the supply a step later, Pa."""
    given = min(max(supply.slope * (supply.pressure - pressure), 0.0), supply.pump)
    rate = 2.0 * np.pi * supply.ripple_hz
    given += supply.ripple * supply.pressure * supply.capacity * rate * np.cos(rate * time)
    return max(pressure + STEP * (given - drawn) / supply.capacity, 0.05 * supply.pressure)
