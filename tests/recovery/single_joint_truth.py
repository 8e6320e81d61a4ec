"""One hydraulic joint, from the pump to the load, in closed loop under its own position or torque controller.

Two chambers with compressible oil, a four-land valve with spool lag and overlap, an accumulator that a pressure-compensated
pump fills, a load with gravity between two end stops (Merritt, Hydraulic Control Systems, 1967). It shares no code with the
package but the writer of log sets. Pa, m³, N·m, rad, s.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.signal import butter, sosfiltfilt

from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.trajectory import LogSet
from hqpipe.logs.writer import LogSetWriter

JOINT = "boom"
INNER_S = 5e-5  # step of the integration
SETTLING_S = 1.0  # not logged: pressures and load come to rest


class Machine(NamedTuple):
    """The joint and its supply; what a test plants is a change of these."""

    area_a: float = 4.5e-4  # m², its pressure raises the torque
    area_b: float = 4.5e-4
    lever: float = 0.05  # m
    idle_volume: float = 5e-5  # m³, of each side: hoses and dead volume
    bulk: float = 1.0e9
    flow_gain: float = 6.0e-8  # m³/s/√Pa at full opening
    overlap: float = 0.0  # share of the full opening
    spool_s: float = 0.002
    leakage: float = 4.0e-13  # m³/s/Pa across the piston
    pressure: float = 1.6e7  # where the pump stops
    tank: float = 4e5
    pump_flow: float = 1e-2  # m³/s, the most it gives
    pump_slope: float = 1e-9  # m³/s per Pa below `pressure`
    accumulator: float = 2.0e-11  # m³/Pa
    inertia: float = 2.0  # kg·m²
    damping: float = 15.0  # N·m·s/rad
    gravity: float = 60.0  # N·m, times cos q
    lower: float = -0.9  # end stops
    upper: float = 0.9
    stop_stiffness: float = 4e5  # N·m/rad
    stop_damping: float = 1e3
    position_gain: float = 5.0  # opening per rad
    torque_gain: float = 3e-3  # opening per N·m
    delay: float = 0.0  # s, of the command
    extending: float = 1.0  # opening × this where it is above 0


WEAK_SUPPLY = {"pump_slope": 1.6e-11, "accumulator": 2.4e-12}  # 0.15 s, and half the pressure at 5 rad/s
LIMITED_PUMP = {"pump_flow": 2.5e-5, "pump_slope": 1e-10, "accumulator": 3e-12}


@njit(cache=True)
def root(drop: float) -> float:
    """Signed square root, laminar below 1e4 Pa, so that its slope stays finite."""
    return drop / np.sqrt(abs(drop) + 1e4)


@njit(cache=True)
def slopes(m: Machine, y: np.ndarray, opening: float) -> np.ndarray:
    """Time derivative of (q, q̇, pa, pb, spool, supply) under a controller that asks for `opening`."""
    q, speed, pa, pb, spool, supply = y
    x = spool * (m.extending if spool > 0.0 else 1.0)
    x = x - m.overlap if x > m.overlap else (x + m.overlap if x < -m.overlap else 0.0)
    if x >= 0.0:
        qa, qb = m.flow_gain * x * root(supply - pa), m.flow_gain * x * root(m.tank - pb)
        drawn = qa
    else:
        qa, qb = -m.flow_gain * x * root(m.tank - pa), -m.flow_gain * x * root(supply - pb)
        drawn = qb
    across = m.leakage * (pa - pb)
    va = m.idle_volume + m.area_a * m.lever * (q - m.lower)
    vb = m.idle_volume + m.area_b * m.lever * (m.upper - q)
    stop = 0.0
    if q > m.upper:
        stop = -m.stop_stiffness * (q - m.upper) - m.stop_damping * max(speed, 0.0)
    elif q < m.lower:
        stop = -m.stop_stiffness * (q - m.lower) - m.stop_damping * min(speed, 0.0)
    torque = m.lever * (pa * m.area_a - pb * m.area_b)
    pumped = min(max(m.pump_slope * (m.pressure - supply), 0.0), m.pump_flow)
    return np.array(
        [
            speed,
            (torque - m.gravity * np.cos(q) - m.damping * speed + stop) / m.inertia,
            m.bulk / va * (qa - across - m.area_a * m.lever * speed),
            m.bulk / vb * (qb + across + m.area_b * m.lever * speed),
            (min(max(opening, -1.0), 1.0) - spool) / m.spool_s,
            (pumped - max(drawn, 0.0)) / m.accumulator,
        ]
    )


@njit(cache=True)
def run(m: Machine, wanted: np.ndarray, dt: float, torque_mode: bool, knocks: np.ndarray) -> np.ndarray:
    """(samples, 5) position, velocity, torque, command and supply pressure under a sampled controller.

    Args:
        wanted: (samples,) position, or in torque mode what is added to a soft spring and damper round the middle.
        knocks: (samples,) torque on the load.
    """
    half = 0.5 * (m.pressure + m.tank)
    load = m.gravity / m.lever / (m.area_a + m.area_b)
    y = np.array([0.0, 0.0, half + load, half * m.area_a / m.area_b - load, 0.0, m.pressure])
    if not torque_mode:
        y[0] = min(max(wanted[0], m.lower), m.upper)
    log, late = np.empty((wanted.shape[0], 5)), round(m.delay / dt)
    inner = round(dt / INNER_S)
    for k in range(wanted.shape[0]):
        torque = m.lever * (y[2] * m.area_a - y[3] * m.area_b)
        command = wanted[k]
        if torque_mode:
            command += m.gravity * np.cos(y[0]) - 60.0 * y[0] - 6.0 * y[1]
        log[k] = y[0], y[1], torque, command, y[5]
        asked = log[max(k - late, 0), 3]
        opening = m.torque_gain * (asked - torque) if torque_mode else m.position_gain * (asked - y[0])
        push = np.array([0.0, knocks[k] / m.inertia, 0.0, 0.0, 0.0, 0.0])
        for _ in range(inner):
            a = slopes(m, y, opening) + push
            b = slopes(m, y + 0.5 * INNER_S * a, opening) + push
            c = slopes(m, y + 0.5 * INNER_S * b, opening) + push
            d = slopes(m, y + INNER_S * c, opening) + push
            y = y + INNER_S / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            y[2], y[3] = max(y[2], 0.0), max(y[3], 0.0)  # cavitation
    return log


def excitation(rng: np.random.Generator, samples: int, dt: float, highest: float) -> np.ndarray:
    """(samples,) band-limited noise of unit deviation whose strength swells and fades, so that there are slow spells too."""
    wave = sosfiltfilt(butter(2, highest, fs=1.0 / dt, output="sos"), rng.standard_normal(samples))
    swell = 1.0 + 0.6 * np.sin(2.0 * np.pi * np.arange(samples) * dt / 4.0 + rng.uniform(0.0, 2.0 * np.pi))
    return wave / wave.std() * swell


def strokes(rng: np.random.Generator, samples: int, dt: float, reach: float) -> np.ndarray:
    """(samples,) positions: from stop to stop and a rest there, with a target `reach` beyond the stop."""
    wanted, at, side = np.empty(samples), 0, 1.0
    while at < samples:
        travel, rest = (round(s / dt) for s in (rng.uniform(0.5, 1.2), rng.uniform(0.5, 1.2)))
        ramp = side * reach * -np.cos(np.pi * np.arange(travel) / travel)
        part = np.concatenate([ramp, np.full(rest, side * reach)])[: samples - at]
        wanted[at : at + len(part)] = part
        at, side = at + len(part), -side
    return wanted


def write_logs(
    folder: Path,
    mode: str = "position",
    *,
    seconds: float = 8.0,
    trials: int = 4,
    rate_hz: float = 1000.0,
    seed: int = 0,
    noise: float = 2.0,
    amplitude: float | None = None,
    at_stops: bool = False,
    pressure: bool = False,
    **changed: float,
) -> LogSet:
    """A log set of trials of one joint, the last of which is held out.

    Args:
        mode: position or torque. noise: of the torque reading, N·m.
        amplitude: of the command, rad or N·m. at_stops: strokes from stop to stop instead of band-limited noise.
        pressure: log the supply pressure. changed: fields of `Machine`.
    """
    m, dt = Machine(**changed), 1.0 / rate_hz
    settling, samples = round(SETTLING_S / dt), round((SETTLING_S + seconds) / dt)
    torque_mode = mode == "torque"
    size = amplitude or (90.0 if torque_mode else 0.22)
    command = "effort_command" if torque_mode else "position_command"
    with LogSetWriter(folder, base="fixed", control_mode=mode, effort_source="load_cell", rate_hz=rate_hz) as writer:
        for i in range(trials):
            rng = np.random.default_rng(1000 * seed + i)
            wanted = (
                strokes(rng, samples, dt, 1.02 * m.upper)
                if at_stops
                else size * excitation(rng, samples, dt, 4.0 if torque_mode else 1.5)
            )
            knocks = 15.0 * excitation(rng, samples, dt, 15.0)
            q, speed, torque, asked, supply = run(m, wanted, dt, torque_mode, knocks)[settling:].T
            columns = {
                "time": np.arange(len(q)) * dt,
                f"joint/{JOINT}/position": q + 2e-5 * rng.standard_normal(len(q)),
                f"joint/{JOINT}/velocity": speed + 5e-3 * rng.standard_normal(len(q)),
                f"joint/{JOINT}/effort": torque + noise * rng.standard_normal(len(q)),
                f"joint/{JOINT}/{command}": asked,
            }
            if pressure:
                columns["supply/pressure"] = supply + 2e4 * rng.standard_normal(len(q))
            writer.add(f"trial_{i}.parquet", columns, split="heldout" if i == trials - 1 else "fit")
    return read_log_set(folder)
