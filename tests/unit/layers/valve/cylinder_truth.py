"""A cylinder on a four-way valve: unequal areas, orifice flow, a spool with overlap and lag, end stops, a pump that sags.

Integrated by scipy with equations and code of its own; the layer under test knows none of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

STROKE = 0.5  # m
AREA_A = 2.0e-3  # m²
SUPPLY = 16e6  # Pa
FULL_SPEED = 0.25  # m/s, extending at full opening without load
HELD = 12e3  # N, the largest load that a counterbalance valve is set for
PUMP_S = 0.15  # s, in which the supply pressure follows the flow


def rod_speed(opening, supply, area_b, weight, pilot=0.0):
    """m/s of the rod, from the orifice equation of both edges and the balance of forces (oil without compression).

    With Q = K x √Δp at both edges, pA·A − pB·B = weight gives v = K x √((p·A − weight)/(A³ + B³)) extending, and
    K x √((p·B + weight)/(A³ + B³)) retracting. A counterbalance valve of the ratio R holds the load until pB·R + pA reaches its
    setting, so that the edge to chamber B alone meters: v = K x √(p − pB)/B.

    Args:
        pilot: ratio of the counterbalance valve, set to 1.3 times the pressure of `HELD`; 0 where there is none.
    """
    cubes = AREA_A**3 + area_b**3
    k = FULL_SPEED * np.sqrt(cubes / (SUPPLY * AREA_A))
    if pilot > 0.0 and opening < 0.0:
        needed = max(1.3 * HELD / AREA_A - weight / AREA_A, 0.0) / (pilot + area_b / AREA_A)
        return k * opening * np.sqrt(max(supply - needed, 0.0)) / area_b
    driving = supply * AREA_A - weight if opening > 0.0 else supply * area_b + weight
    return k * opening * np.sqrt(max(driving, 0.0) / cubes)


def load(x, weight, spring):
    """N that pulls the rod in at the position x."""
    return weight + spring * (x - 0.5 * STROKE)


def simulate(
    command,
    dt,
    area_ratio=1.0,
    overlap=0.0,
    spool_s=5e-3,
    delay=0.0,
    droop=0.0,
    weight=0.0,
    spring=0.0,
    start=0.25,
    jump=0.0,
    apart=0.0,
    behind_s=0.0,
    leak=0.0,
    lowest=-np.inf,
    pilot=0.0,
):
    """(T,) position of the rod, m, and supply pressure, Pa.

    Args:
        command: (T,) −1 … 1, held for dt s. area_ratio: of the piston's two sides. overlap: of the command. spool_s: its lag.
        delay: s. droop: share of the supply pressure that is lost at full speed. weight: N, pulls the
            rod in. spring: N/m, pulls it to the middle. jump: share of the full opening that the edge of the overlap opens.
        apart: s, dead time of extending less that of retracting. behind_s: lag of the flow behind the lands.
        leak: m/s per N. lowest: m/s, of the rod. pilot: as in `rod_speed`.
    """

    def sent(t):
        return command[min(max(int(np.floor(t / dt + 1e-9)), 0), len(command) - 1)]

    area_b = AREA_A / area_ratio

    def slope(t, y):
        x, spool, supply, flowing = y
        u = max(sent(t - delay - max(apart, 0.0)), 0.0) + min(sent(t - delay - max(-apart, 0.0)), 0.0)
        opening = np.sign(spool) * ((1.0 - jump) * (abs(spool) - overlap) + jump * (1.0 - overlap))
        opening = opening if abs(spool) > overlap else 0.0
        force = load(x, weight, spring)
        v = rod_speed(flowing if behind_s else opening, supply, area_b, force, pilot) - leak * force
        v = max(v, lowest)
        if (x <= 0.0 and v < 0.0) or (x >= STROKE and v > 0.0):
            v = 0.0
        follows = (opening - flowing) / behind_s if behind_s else 0.0
        return [v, (u - spool) / spool_s, (SUPPLY * (1.0 - droop * abs(v) / FULL_SPEED) - supply) / PUMP_S, follows]

    time = np.arange(len(command)) * dt
    found = solve_ivp(slope, (0.0, time[-1]), [start, 0.0, SUPPLY, 0.0], "RK23", time, max_step=0.5 * dt, rtol=1e-4)
    return np.clip(found.y[0], 0.0, STROKE), found.y[2]


def strokes(seconds, dt, seed, levels, pause=0.0, hold=(0.3, 1.2)):
    """(T,) commands of random level and length, each turned against the one before."""
    rng, parts, sign = np.random.default_rng(seed), [], 1.0
    while sum(len(p) for p in parts) * dt < seconds:
        parts.append(np.full(round(rng.uniform(*hold) / dt), sign * rng.uniform(*levels)))
        parts.append(np.zeros(round(pause / dt)))
        sign = -sign
    return np.concatenate(parts)[: round(seconds / dt)]


def log_set(commands, dt, noise=5e-5, neutral=0.0, kind="prismatic", gauge=False, **machine):
    """A log set of one cylinder that records positions, and with `gauge` its supply; the last trial is held out."""
    trials = []
    for i, command in enumerate(commands):
        position, supply = simulate(command, dt, **machine)
        position = position + noise * np.random.default_rng(i).standard_normal(len(position))
        trajectory = Trajectory(
            time=np.arange(len(command)) * dt,
            joints=("rod",),
            position=position[:, None],
            velocity=differentiate(position[:, None], dt),
            effort=load(position, machine.get("weight", 0.0), machine["spring"])[:, None]
            if "spring" in machine
            else None,
            valve_command=(command + neutral)[:, None],
            velocity_source="differentiated",
            extra={"supply/pressure": supply} if gauge else {},
        )
        trials.append(Trial(f"trial_{i}.parquet", "heldout" if i == len(commands) - 1 else "fit", None, trajectory))
    return LogSet(
        path=Path("cylinder"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="valve",
        effort_source=None,
        rate_hz=1.0 / dt,
        joints=("rod",),
        trials=tuple(trials),
        kinds={"rod": kind},
    )
