"""Compiled loop of hydraulic cylinders that are commanded in force: a host's motion control, a force loop on the valve."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)
from hqpipe.benchmark.cases.cylinder.hydraulics import (
    PA,
    PB,
    RETURN,
    SPOOL,
    V,
    X,
    advance,
    at_rest,
    load,
    opening,
    supplied,
)

LOOP = np.dtype(
    [
        (name, np.float64)
        for name in (
            "force_gain speed_gain "  # command/N, command·s/m: force loop, and what it gives for the piston's own speed
            "nominal share_a "  # Pa of the supply that the loop reckons with, part of chamber A in the stiffness of the oil
            "cell_lag speed_lag "  # s, of the force and the speed that the loop reads
            "inertia stiffness damping weight "  # kg, 1/s², 1/s, 1: motion control, share of the load it knows
            "force_limit"  # N, which the host asks for at most
        ).split()
    ],
    align=True,
)
"""Control of one cylinder."""

HOST_LAG: Final = 5.0e-3  # s, of the speed that the host derives from the position; assumption
MOST: Final = 2.0  # by which a drive opens further for a small pressure drop; assumption, so that it stays finite


@njit(cache=True, nogil=True)
def evened(axis, loop, state, command: float) -> float:
    """The command of the force loop over what the edges' pressure drops make of it, as of an unloaded piston.

    Drives with pressure sensors linearise the flow so (Boaventura et al. 2012), with the nominal pressure of the supply.
    """
    ratio = axis.area_b / axis.area_a
    if command > 0.0:
        a, b, usual = loop.nominal - state[PA], state[PB] - RETURN, loop.nominal / (1.0 + ratio)
    else:
        a, b, usual = state[PA] - RETURN, loop.nominal - state[PB], loop.nominal * ratio / (1.0 + ratio)
    root = loop.share_a * np.sqrt(max(a, 0.0)) + (1.0 - loop.share_a) * np.sqrt(max(b, 0.0))
    return command * min(np.sqrt(usual) / max(root, 1.0), MOST)


@njit(cache=True, nogil=True)
def run_force_cylinders(
    axes, loops, supply, reference, speed, acceleration, lost, late, resolution, dt, every, keep, start, kept
):
    """Run all cylinders along their references.

    Args:
        axes: (J,) of `hydraulics.AXIS`. loops: (J,) of `LOOP`. supply: (4,) as of `hydraulics.run_cylinders`.
        reference, speed, acceleration: (T, J) m, m/s, m/s², which the host follows. lost: (T, J) a frame that is lost.
        late: (J,) steps between host and force loop. resolution: (J,) m of the sensor that the host reads. dt: s.
        every: steps between two ticks of the host. keep: steps between two rows. start: (J,) m.
        kept: (T // keep, J, 7) position, speed, both pressures, force commanded, supply pressure, force measured.
    """
    count, steps = axes.shape[0], reference.shape[0]
    state, goal, slack, now = np.zeros((count, 7)), np.zeros(count), np.zeros(count), np.zeros(count)
    cell, felt, seen, rate, asked = np.zeros(count), np.zeros(count), start.copy(), np.zeros(count), np.zeros(count)
    sent = np.zeros((count, steps))
    pressure = supply[0]
    for j in range(count):
        at_rest(axes[j], state[j], start[j], pressure)
        cell[j] = load(axes[j], start[j])
        asked[j] = cell[j]
    for i in range(steps):
        drawn, time = 0.0, i * dt
        for j in range(count):
            axis, loop = axes[j], loops[j]
            if i % every == 0:
                place = np.round(state[j, X] / resolution[j]) * resolution[j]
                rate[j] += ((place - seen[j]) / (every * dt) - rate[j]) * min(every * dt / HOST_LAG, 1.0)
                seen[j] = place
                wanted = loop.stiffness * (reference[i, j] - place) + loop.damping * (speed[i, j] - rate[j])
                wanted = loop.inertia * (acceleration[i, j] + wanted) + loop.weight * load(axis, place)
                now[j] = min(max(wanted, -loop.force_limit), loop.force_limit)
            sent[j, i] = now[j]
            if not lost[i, j]:
                asked[j] = sent[j, max(i - late[j], 0)]
            cell[j] += (state[j, PA] * axis.area_a - state[j, PB] * axis.area_b - cell[j]) * dt / loop.cell_lag
            felt[j] += (state[j, V] - felt[j]) * dt / loop.speed_lag
            u = evened(axis, loop, state[j], loop.force_gain * (asked[j] - cell[j]) + loop.speed_gain * felt[j])
            slack[j] = max(min(slack[j], u + axis.play), u - axis.play)
            to = opening(axis, slack[j], time)
            if abs(to - goal[j]) > axis.stiction:
                goal[j] = to
            state[j, SPOOL] += (goal[j] - state[j, SPOOL]) * dt / axis.lag
            drawn += advance(axis, state[j], pressure, dt)
        pressure = supplied(supply, pressure, drawn, dt)
        if i % keep == 0 and i // keep < kept.shape[0]:
            for j in range(count):
                row = kept[i // keep, j]
                row[0], row[1], row[2], row[3] = state[j, X], state[j, V], state[j, PA], state[j, PB]
                row[4], row[5], row[6] = sent[j, i], pressure, cell[j]
