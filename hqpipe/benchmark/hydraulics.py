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
            "coefficient neutral lag "  # m³/(s·√Pa) at full opening, opening, s
            "return_gain "  # factor of the openings that retract, by which the drive evens out the unequal areas
            "side_a side_b load_force load_angle "  # m, m: linkage; N on the cylinder in the middle; rad of its centre of mass
            "loop_gain feedforward sent_limit "  # 1/s, 1, command: the host's position loop
            "overlap limit asymmetry drift "  # command, command, 1, 1/s
            "play stiction hunting hunting_hz jump_from jump_gain"  # command, command, 1, Hz, s, 1
        ).split()
    ],
    align=True,
)
"""One cylinder with valve, load and loop; see `hqpipe.benchmark.cylinder`."""

LAMINAR: Final = 2.0e5  # Pa, below which an edge is laminar, so that its slope stays finite; value assumed
MODULUS: Final = 1.0e9  # Pa, oil with some air in hoses; Jelali and Kroll 2003 give 0.7 to 1.4 GPa
RETURN: Final = 4.0e5  # Pa, the tank line
EMPTY: Final = 1.0e3  # Pa, the least that oil bears before it opens a cavity


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
    u = u - axis.overlap if u > axis.overlap else u + axis.overlap if u < -axis.overlap else 0.0
    u = min(max(u, -axis.limit), axis.limit)
    gain = 1.0 + axis.drift * time + axis.hunting * np.sin(2.0 * np.pi * axis.hunting_hz * time)
    if time >= axis.jump_from:
        gain *= axis.jump_gain
    return u * max(gain, 0.0) * (1.0 + axis.asymmetry if u > 0.0 else 1.0 - axis.asymmetry)


@njit(cache=True, nogil=True)
def run_cylinders(axes, supply, reference, speed, lost, late, resolution, dt, every, keep, start, kept):
    """Run all cylinders along their references.

    Args:
        axes: (J,) of `AXIS`. supply: (4,) pressure, Pa; slope, m³/(s·Pa), by which the pump answers a fall; capacity, m³/Pa;
            its limit, m³/s. reference, speed: (T, J) m and m/s, which the host follows. lost: (T, J) a frame that is lost.
        late: (J,) steps between host and valve. resolution: (J,) m of the sensor that the host reads. dt: s.
        every: steps between two ticks of the host. keep: steps between two rows. start: (J,) m.
        kept: (T // keep, J, 6) position, speed, both pressures, command sent, supply pressure.
    """
    count, steps = axes.shape[0], reference.shape[0]
    x, v, spool, goal, slack = start.copy(), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    sent = np.zeros((steps, count))
    now = np.zeros(count)
    pressure = supply[0]
    pa, pb, steady = np.zeros(count), np.zeros(count), np.zeros(count)
    for j in range(count):
        pb[j] = 0.5 * pressure * axes[j].area_a / (axes[j].area_a + axes[j].area_b)
        pa[j] = (pb[j] * axes[j].area_b + load(axes[j], x[j])) / axes[j].area_a
        steady[j] = pa[j] - pb[j]
    for i in range(steps):
        drawn, time = 0.0, i * dt
        for j in range(count):
            axis = axes[j]
            if i % every == 0:
                seen = np.round(x[j] / resolution[j]) * resolution[j]
                wanted = axis.feedforward * speed[i, j] + axis.loop_gain * (reference[i, j] - seen)
                now[j] = min(max(wanted, -axis.sent_limit), axis.sent_limit)
            sent[i, j] = now[j]
            arrived = sent[max(i - late[j], 0), j]
            if not lost[i, j]:
                slack[j] = max(min(slack[j], arrived + axis.play), arrived - axis.play)
                asked = opening(axis, slack[j], time)
                if abs(asked - goal[j]) > axis.stiction:
                    goal[j] = asked
            spool[j] += (goal[j] - spool[j]) * dt / axis.lag
            s = spool[j]
            k = axis.coefficient * (abs(s) if s > 0.0 else abs(s) * axis.return_gain)
            ratio = axis.area_b / axis.area_a
            if s > 0.0:
                qa, qb = k * edge(pressure - pa[j]), -k * ratio * edge(pb[j] - RETURN)
                drawn += qa
            else:
                qa, qb = -k * edge(pa[j] - RETURN), k * ratio * edge(pressure - pb[j])
                drawn += qb
            across = pa[j] - pb[j]
            steady[j] += (across - steady[j]) * dt / axis.damper_lag
            leak = axis.leakage * across + axis.damper * (across - steady[j])
            va = axis.dead_volume + axis.area_a * x[j]
            vb = axis.dead_volume + axis.area_b * (axis.stroke - x[j])
            pa[j] = max(pa[j] + dt * MODULUS / va * (qa - leak - axis.area_a * v[j]), EMPTY)
            pb[j] = max(pb[j] + dt * MODULUS / vb * (qb + leak + axis.area_b * v[j]), EMPTY)
            force = pa[j] * axis.area_a - pb[j] * axis.area_b - load(axis, x[j])
            v[j] = (v[j] + dt * force / axis.mass) / (1.0 + dt * axis.viscous / axis.mass)
            x[j] += dt * v[j]
            if x[j] < 0.0 or x[j] > axis.stroke:  # the piston lands on its end without rebound
                x[j] = min(max(x[j], 0.0), axis.stroke)
                v[j] = 0.0
        given = min(max(supply[1] * (supply[0] - pressure), 0.0), supply[3])
        pressure = max(pressure + dt * (given - drawn) / supply[2], 0.05 * supply[0])
        if i % keep == 0 and i // keep < kept.shape[0]:
            for j in range(count):
                row = kept[i // keep, j]
                row[0], row[1], row[2], row[3], row[4], row[5] = x[j], v[j], pa[j], pb[j], sent[i, j], pressure
