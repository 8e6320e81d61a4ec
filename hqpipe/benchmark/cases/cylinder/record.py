"""Running hydraulic cylinders and recording them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqpipe.benchmark.cases.cylinder.hydraulics import run_cylinders
from hqpipe.benchmark.cases.cylinder.machine import STEP, CylinderMachine
from hqpipe.benchmark.cases.electric.record import sample_times
from hqpipe.benchmark.cases.motions import course
from hqpipe.benchmark.cases.planted import Motion

KEPT_S = 1.0e-3
KEEP = round(KEPT_S / STEP)
SPEED_LAG = 5.0e-3  # s, of a speed that is derived from the position in the sensor; assumption


def references(machine: CylinderMachine, trial: Motion) -> tuple[np.ndarray, np.ndarray]:
    """(T, J) m and m/s that the host follows."""
    time = np.arange(round(trial.seconds / KEPT_S)) * KEPT_S
    fine = np.arange(round(trial.seconds / STEP)) * STEP
    places, speeds = [], []
    for j, room in enumerate(machine.rooms):
        place = course(trial.names[j], time, room, np.random.default_rng([trial.seed, j]))
        speed = np.clip(np.gradient(place, KEPT_S), -room.speed, room.speed)
        places.append(np.interp(fine, time, place))
        speeds.append(np.interp(fine, time, speed))
    return np.column_stack(places), np.column_stack(speeds)


def record(machine: CylinderMachine, trial: Motion) -> dict[str, np.ndarray]:
    """The columns of a trial as the machine's logger writes them."""
    reference, speed = references(machine, trial)
    count = len(machine.names)
    axes = machine.axes.copy()
    axes["jump_from"] = np.minimum(axes["jump_from"] * trial.seconds, 1e9)  # given as a share of the trial
    kept = np.empty((len(reference) // KEEP, count, 6))
    run_cylinders(
        axes,
        np.array(machine.supply),
        reference,
        speed,
        lost_frames(machine, trial, len(reference)),
        dead_times(machine),
        np.full(count, machine.logger.resolution),
        STEP,
        round(1.0 / machine.logger.host_hz / STEP),
        KEEP,
        reference[0].copy(),
        kept,
    )
    return _logged(machine, trial, kept)


def dead_times(machine: CylinderMachine) -> np.ndarray:
    """(J, 2) steps between the host and each joint's valve, of positive and of negative commands."""
    sensing, count = machine.sensing, len(machine.names)
    both = [sensing.get(f"delay_s/{j}", 0.0) for j in range(count)]
    sides = [[sensing.get(f"delay_{side}_s/{j}", 0.0) + both[j] for side in ("out", "back")] for j in range(count)]
    return np.round(np.array(sides) / STEP).astype(np.int64)


def lost_frames(machine: CylinderMachine, trial: Motion, steps: int) -> np.ndarray:
    """(T, J) True where a command does not arrive."""
    lost = np.zeros((steps, len(machine.names)), dtype=np.bool_)
    for j in range(len(machine.names)):
        if share := machine.sensing.get(f"lost_frames/{j}", 0.0):
            lost[:, j] = _lost(steps, share, np.random.default_rng([trial.seed, j, 7]))
    return lost


def _lost(steps: int, share: float, rng: np.random.Generator) -> np.ndarray:
    """(T,) True in stretches of 60 to 250 ms, in `share` of the time."""
    lost, at = np.zeros(steps, dtype=np.bool_), 0
    while at < steps:
        at += round(rng.exponential(0.15 * (1.0 - share) / share) / STEP)
        length = round(rng.uniform(0.06, 0.25) / STEP)
        lost[at : at + length] = True
        at += length
    return lost


def logged_motion(
    machine: Any, j: int, kept: np.ndarray, time: np.ndarray, speed_noise: float, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Position, and speed where it is logged, of a cylinder or of the joint that it turns.

    Args:
        kept: (T, J, ≥ 2) position and speed, a row each `KEPT_S`. time: (N,) s. speed_noise: share of the full speed.
    """
    from scipy.signal import lfilter

    log, name, radius = machine.logger, machine.names[j], machine.radius_of(j)
    fine = np.arange(len(kept)) * KEPT_S
    place = np.interp(time, fine, kept[:, j, 0]) + rng.normal(0.0, log.noise, len(time))
    place = np.round(place / log.resolution) * log.resolution
    if machine.kinds[j] == "revolute":
        place = place - 0.5 * machine.axes["stroke"][j]
    found = {f"joint/{name}/position": place / radius}
    if log.speed:
        share = 1.0 - np.exp(-KEPT_S / SPEED_LAG)
        speed = lfilter([share], [1.0, share - 1.0], kept[:, j, 1])
        noise = rng.normal(0.0, speed_noise * machine.top_speed[j], len(time))
        found[f"joint/{name}/velocity"] = (np.interp(time, fine, speed) + noise) / radius
    return found


def _logged(machine: CylinderMachine, trial: Motion, kept: np.ndarray) -> dict[str, np.ndarray]:
    log, rng = machine.logger, np.random.default_rng([trial.seed, 99])
    time = sample_times(trial.seconds, log.rate_hz, log.jitter, rng)
    fine = np.arange(len(kept)) * KEPT_S
    row = np.clip(np.floor(time / KEPT_S + 1e-6).astype(np.int64), 0, len(kept) - 1)
    found: dict[str, np.ndarray] = {"time": time}
    for j, name in enumerate(machine.names):
        found |= logged_motion(machine, j, kept, time, 0.005, rng)
        found[f"joint/{name}/valve_command"] = kept[row, j, 4]
        if log.pressures:
            a = np.interp(time, fine, kept[:, j, 2]) + rng.normal(0.0, log.pressure_noise, len(time))
            b = np.interp(time, fine, kept[:, j, 3]) + rng.normal(0.0, log.pressure_noise, len(time))
            found[f"joint/{name}/pressure_a"], found[f"joint/{name}/pressure_b"] = np.abs(a), np.abs(b)
            force = a * machine.axes["area_a"][j] - b * machine.axes["area_b"][j]
            found[f"joint/{name}/effort"] = force * (machine.radius_of(j) if machine.kinds[j] == "revolute" else 1.0)
    if log.supply:
        found["supply/pressure"] = np.interp(time, fine, kept[:, 0, 5]) + rng.normal(0.0, log.pressure_noise, len(time))
    return found
