"""Running a trial of a legged machine, and what its logger writes: every n-th tick, without a filter against aliasing."""

from __future__ import annotations

import numpy as np

from hqpipe.benchmark.cases.legged.draw import TICK, LeggedMachine, LeggedTrial, seconds_of
from hqpipe.benchmark.cases.legged.hydraulics import lever
from hqpipe.benchmark.cases.legged.motions import BEFORE_S, commands, plate_height
from hqpipe.benchmark.cases.legged.run import (
    CELL,
    COLUMNS,
    OIL,
    POSITION,
    ROW_A,
    ROW_B,
    ROW_SUPPLY,
    VELOCITY,
    run_legs,
)

LOST_S = (0.03, 0.15)  # s, for how long commands stay away at a time; assumption
STALE_S = (0.01, 0.06)  # s, for how long a torque channel repeats its last value; assumption


def simulate(machine: LeggedMachine, trial: LeggedTrial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T, J) commands, (T, J, 9) of `cases.legged.run.COLUMNS` and (T, L, 3) N on the feet, a row each tick."""
    robot, wanted, before = machine.robot, commands(machine, trial), round(BEFORE_S / TICK)
    kept = np.empty((len(wanted) - before, len(machine.names), len(COLUMNS)))
    feet = np.empty((len(kept), len(robot.legs), 3))
    run_legs(
        robot.body,
        machine.cylinders,
        machine.faulty,
        machine.supplies,
        np.array(seconds_of(machine, trial)),
        wanted,
        _lost(machine, trial, len(wanted)),
        before,
        robot.resolution,
        robot.velocity_filter_hz,
        np.array([plate_height(robot), trial.plate]),
        kept,
        feet,
    )
    return wanted[before:], kept, feet


def _lost(machine: LeggedMachine, trial: LeggedTrial, ticks: int) -> np.ndarray:
    """(T, J) True where a command does not arrive."""
    found = np.zeros((ticks, len(machine.names)), dtype=np.bool_)
    for j in np.flatnonzero(machine.faulty["lost_share"]):
        found[:, j] = stretches(
            ticks, machine.faulty["lost_share"][j], LOST_S, np.random.default_rng([trial.seed, j, 7])
        )
    return found


def stretches(ticks: int, share: float, length_s: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """(T,) True in stretches of random length, in about `share` of the time."""
    found, at = np.zeros(ticks, dtype=np.bool_), 0
    mean = 0.5 * sum(length_s)
    while at < ticks:
        at += round(rng.exponential(mean * (1.0 - share) / share) / TICK) + 1
        length = round(rng.uniform(*length_s) / TICK)
        found[at : at + length] = True
        at += length
    return found


def record(machine: LeggedMachine, trial: LeggedTrial) -> dict[str, np.ndarray]:
    """The columns of a trial, SI units."""
    log, (wanted, kept, feet) = machine.logger, simulate(machine, trial)
    rng = np.random.default_rng([trial.seed, 99])
    rows = np.arange(0, len(kept), log.every)
    found: dict[str, np.ndarray] = {"time": rows * TICK}
    for j, name in enumerate(machine.names):
        bias = np.where(_acting(machine, trial, len(kept)), machine.faulty["torque_bias"][j], 0.0)
        found[f"joint/{name}/position"] = kept[rows, j, POSITION]
        if log.speed:
            found[f"joint/{name}/velocity"] = kept[rows, j, VELOCITY]
        found[f"joint/{name}/effort"] = torque_channel(machine, trial, j, kept, bias, rng)[rows]
        found[f"joint/{name}/position_command"] = wanted[rows, j]
        if log.pressures:
            arm = lever(machine.cylinders[j], machine.robot.stand[j])[1]
            off = bias / (arm * machine.cylinders["area_a"][j]) if log.effort_source == "pressure" else 0.0 * bias
            for side, column, shift in (("a", ROW_A, off), ("b", ROW_B, 0.0 * off)):
                noise = rng.normal(0.0, log.pressure_noise, len(rows))
                found[f"joint/{name}/pressure_{side}"] = np.abs(kept[rows, j, column] + shift[rows] + noise)
    if log.supply:
        found["supply/pressure"] = kept[rows, 0, ROW_SUPPLY] + rng.normal(0.0, log.pressure_noise, len(rows))
    for leg, name in enumerate(machine.robot.legs):
        for axis, letter in enumerate("xyz"):
            found[f"foot/{name}/force/{letter}"] = feet[rows, leg, axis]
    return found


def _acting(machine: LeggedMachine, trial: LeggedTrial, ticks: int) -> np.ndarray:
    """(T,) where the effects act."""
    start, stop = seconds_of(machine, trial)
    time = np.arange(ticks) * TICK
    return (time >= start) & (time < stop)


def torque_channel(
    machine: LeggedMachine, trial: LeggedTrial, j: int, kept: np.ndarray, bias: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(T,) N·m of one joint's torque sensor, with what is wrong with the channel and its noise."""
    joint, sensor = machine.faulty[j], kept[:, j, CELL if machine.logger.effort_source == "load_cell" else OIL]
    acting = _acting(machine, trial, len(kept))
    time = np.arange(len(kept)) * TICK
    late = np.interp(time - joint["skew_s"], time, sensor)
    found = np.where(acting, late, sensor) + bias
    found += rng.normal(0.0, machine.logger.torque_noise * machine.top_torque[j], len(kept))
    if joint["stale_share"] > 0.0:
        held = stretches(len(kept), joint["stale_share"], STALE_S, np.random.default_rng([trial.seed, j, 8])) & acting
        at = np.where(held, 0, np.arange(len(kept)))
        found = found[np.maximum.accumulate(at)]
    return np.where(acting & (joint["unsigned"] > 0.0), np.abs(found), found)
