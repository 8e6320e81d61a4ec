"""Compiled loop of hydraulic cylinders: valve, orifices, two chambers of unequal area, a load on a linkage, one supply.

Flow through an edge is K x √Δp (Merritt 1967, ch. 3), the chambers obey dp/dt = β/V (Q − A v). Pressures, speed and position
are advanced one after the other with the newest values (semi-implicit Euler).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)

AXIS = np.dtype(
    [
        (name, np.float64)
        for name in (
            "area_a area_b stroke dead_volume mass viscous "  # m², m², m, m³, kg, N·s/m
            "leakage damper damper_lag "  # m³/(s·Pa) between the chambers: always, and of what changes faster than the lag, s
            "worn "  # m³/(s·Pa) of leakage past a worn piston
            "coefficient neutral lag "  # m³/(s·√Pa) at full opening, opening, s
            "return_gain "  # factor of the openings that retract, by which the drive evens out the unequal areas
            "side_a side_b load_force load_angle "  # m, m: linkage; N on the cylinder in the middle; rad of its centre of mass
            "loop_gain feedforward sent_limit "  # 1/s, 1, command: the host's position loop
            "overlap edge_jump limit asymmetry drift "  # command, opening, command, 1, 1/s
            "meter_out "  # factor on the edge through which the retracting piston's oil returns
            "hold_flow hold_setting hold_span hold_ratio "  # m³/(s·√Pa) when open, Pa, Pa, 1: load-holding valve, none at 0
            "play stiction hunting hunting_hz jump_from jump_gain"  # command, command, 1, Hz, s, 1
        ).split()
    ],
    align=True,
)
"""One cylinder with valve, load and loop; see `hqpipe.benchmark.cases.cylinder.machine`."""

LAMINAR: Final = 2.0e5  # Pa, below which an edge is laminar, so that its slope stays finite; value assumed
MODULUS: Final = 1.0e9  # Pa, oil with some air in hoses; Jelali and Kroll 2003 give 0.7 to 1.4 GPa
RETURN: Final = 4.0e5  # Pa, the tank line
EMPTY: Final = 1.0e3  # Pa, the least that oil bears before it opens a cavity
HOLD_LAG: Final = 0.01  # s, of a load-holding valve and its damping orifice; assumption: usual ones take 5 to 20 ms


@njit(cache=True, nogil=True)
def edge(difference: float) -> float:
    """√Δp with its sign, √Pa; a straight line in the laminar range."""
    size = abs(difference)
    root = np.sqrt(size) if size > LAMINAR else size / np.sqrt(LAMINAR)
    return root if difference > 0.0 else -root


@njit(cache=True, nogil=True)
def load(axis, position: float) -> float:
    """Force of gravity on the cylinder, N: a mass on a link that the cylinder turns, by the law of cosines."""
    length = axis.side_b + position  # the shortest cylinder is as long as the longer side
    cosine = (axis.side_a**2 + axis.side_b**2 - length**2) / (2.0 * axis.side_a * axis.side_b)
    angle = np.arccos(min(max(cosine, -0.98), 0.98))
    lever = axis.side_a * axis.side_b * np.sin(angle) / length
    return axis.load_force * np.cos(angle - axis.load_angle) * (0.7 * axis.side_a) / max(lever, 0.2 * axis.side_a)


@njit(cache=True, nogil=True)
def opening(axis, command: float, time: float) -> float:
    """Where the spool is to go, from the command that reached the valve."""
    u = command - axis.neutral
    if abs(u) <= axis.overlap:
        return 0.0
    u = u - axis.overlap + axis.edge_jump if u > 0.0 else u + axis.overlap - axis.edge_jump
    u = min(max(u, -axis.limit), axis.limit)
    gain = 1.0 + axis.drift * time + axis.hunting * np.sin(2.0 * np.pi * axis.hunting_hz * time)
    if time >= axis.jump_from:
        gain *= axis.jump_gain
    return u * max(gain, 0.0) * (1.0 + axis.asymmetry if u > 0.0 else 1.0 - axis.asymmetry)


@njit(cache=True, nogil=True)
def returned(axis, k: float, pressure: float, held: float) -> float:
    """Flow out of the loaded chamber, m³/s, through the spool's edge and the load-holding valve before it.

    Args:
        k: of the spool's edge, m³/(s·√Pa). pressure: of the chamber, Pa. held: opening of the load-holding valve, 0 to 1.
    """
    k *= axis.meter_out
    if axis.hold_flow > 0.0:
        valve = axis.hold_flow * held
        k = k * valve / max(np.sqrt(k**2 + valve**2), 1e-30)  # two sharp edges in series
    return k * edge(pressure - RETURN)


X, V, SPOOL, PA, PB, STEADY, HELD = range(7)
"""Columns of a cylinder's state: m, m/s, opening, Pa, Pa, Pa across the piston on average, opening of its holding valve."""


@njit(cache=True, nogil=True)
def advance(axis, state, pressure: float, dt: float) -> float:
    """Advance one cylinder by a step with its spool where it is; the flow that it draws, m³/s.

    Args:
        axis: of `AXIS`. state: (7,) see `X`; changed. pressure: of the supply, Pa. dt: s.
    """
    s, pa, pb, ratio = state[SPOOL], state[PA], state[PB], axis.area_b / axis.area_a
    k = axis.coefficient * (abs(s) if s > 0.0 else abs(s) * axis.return_gain)
    if s > 0.0:
        qa, qb = k * edge(pressure - pa), -k * ratio * edge(pb - RETURN)
        if axis.hold_flow > 0.0:
            qa = max(qa, 0.0)  # a check valve lets oil in and none out
        drawn = qa
    else:
        qa, qb = -returned(axis, k, pa, state[HELD]), k * ratio * edge(pressure - pb)
        drawn = qb
    if axis.hold_flow > 0.0:
        pilot = (pa + axis.hold_ratio * pb - axis.hold_setting) / axis.hold_span
        state[HELD] += (min(max(pilot, 0.0), 1.0) - state[HELD]) * dt / HOLD_LAG
    across = pa - pb
    state[STEADY] += (across - state[STEADY]) * dt / axis.damper_lag
    leak = (axis.leakage + axis.worn) * across + axis.damper * (across - state[STEADY])
    va = axis.dead_volume + axis.area_a * state[X]
    vb = axis.dead_volume + axis.area_b * (axis.stroke - state[X])
    state[PA] = max(pa + dt * MODULUS / va * (qa - leak - axis.area_a * state[V]), EMPTY)
    state[PB] = max(pb + dt * MODULUS / vb * (qb + leak + axis.area_b * state[V]), EMPTY)
    force = state[PA] * axis.area_a - state[PB] * axis.area_b - load(axis, state[X])
    state[V] = (state[V] + dt * force / axis.mass) / (1.0 + dt * axis.viscous / axis.mass)
    state[X] += dt * state[V]
    if state[X] < 0.0 or state[X] > axis.stroke:  # the piston lands on its end without rebound
        state[X] = min(max(state[X], 0.0), axis.stroke)
        state[V] = 0.0
    return drawn


@njit(cache=True, nogil=True)
def at_rest(axis, state, position: float, pressure: float) -> None:
    """Put a cylinder to rest where it carries its load."""
    state[:] = 0.0
    state[X] = position
    force = load(axis, position)
    state[PB] = 0.5 * pressure * axis.area_a / (axis.area_a + axis.area_b) + max(-force, 0.0) / axis.area_b
    state[PA] = (state[PB] * axis.area_b + force) / axis.area_a
    state[STEADY] = state[PA] - state[PB]


@njit(cache=True, nogil=True)
def supplied(supply, pressure: float, drawn: float, dt: float) -> float:
    """Pressure of the supply a step later, Pa; arguments as of `run_cylinders`."""
    given = min(max(supply[1] * (supply[0] - pressure), 0.0), supply[3])
    return max(pressure + dt * (given - drawn) / supply[2], 0.05 * supply[0])


@njit(cache=True, nogil=True)
def two_sided(sent, i: int, late, neutral: float) -> float:
    """The command that reaches a valve, one solenoid for each direction, with a dead time of its own.

    Args:
        sent: (T,) commands. i: step. late: (2,) steps, of the positive and the negative side.
    """
    out, back = sent[max(i - late[0], 0)], sent[max(i - late[1], 0)]
    if late[0] == late[1]:
        return out
    return neutral + max(out - neutral, 0.0) + min(back - neutral, 0.0)


@njit(cache=True, nogil=True)
def run_cylinders(axes, supply, reference, speed, lost, late, resolution, dt, every, keep, start, kept):
    """Run all cylinders along their references.

    Args:
        axes: (J,) of `AXIS`. supply: (4,) pressure, Pa; slope, m³/(s·Pa), by which the pump answers a fall; capacity, m³/Pa;
            its limit, m³/s. reference, speed: (T, J) m and m/s, which the host follows. lost: (T, J) a frame that is lost.
        late: (J, 2) steps between host and valve, of positive and negative commands. resolution: (J,) m of the sensor that the
            host reads. dt: s. every: steps between two ticks of the host. keep: steps between two rows. start: (J,) m.
        kept: (T // keep, J, 6) position, speed, both pressures, command sent, supply pressure.
    """
    count, steps = axes.shape[0], reference.shape[0]
    state, goal, slack, now = np.zeros((count, 7)), np.zeros(count), np.zeros(count), np.zeros(count)
    sent = np.zeros((count, steps))
    pressure = supply[0]
    for j in range(count):
        at_rest(axes[j], state[j], start[j], pressure)
    for i in range(steps):
        drawn, time = 0.0, i * dt
        for j in range(count):
            axis = axes[j]
            if i % every == 0:
                seen = np.round(state[j, X] / resolution[j]) * resolution[j]
                wanted = axis.feedforward * speed[i, j] + axis.loop_gain * (reference[i, j] - seen)
                now[j] = min(max(wanted, -axis.sent_limit), axis.sent_limit)
            sent[j, i] = now[j]
            if not lost[i, j]:
                arrived = two_sided(sent[j], i, late[j], axis.neutral)
                slack[j] = max(min(slack[j], arrived + axis.play), arrived - axis.play)
                asked = opening(axis, slack[j], time)
                if abs(asked - goal[j]) > axis.stiction:
                    goal[j] = asked
            state[j, SPOOL] += (goal[j] - state[j, SPOOL]) * dt / axis.lag
            drawn += advance(axis, state[j], pressure, dt)
        pressure = supplied(supply, pressure, drawn, dt)
        if i % keep == 0 and i // keep < kept.shape[0]:
            for j in range(count):
                row = kept[i // keep, j]
                row[0], row[1], row[2], row[3] = state[j, X], state[j, V], state[j, PA], state[j, PB]
                row[4], row[5] = sent[j, i], pressure
