"""Running hydraulic cylinders that are commanded in force, and recording them."""

from __future__ import annotations

import numpy as np

from hqpipe.benchmark.cases.cylinder.machine import STEP
from hqpipe.benchmark.cases.cylinder.record import KEEP, dead_times, logged_motion, lost_frames
from hqpipe.benchmark.cases.electric.record import sample_times
from hqpipe.benchmark.cases.force_cylinder.loop import run_force_cylinders
from hqpipe.benchmark.cases.force_cylinder.machine import KEPT_S, ForceMachine, motion
from hqpipe.benchmark.cases.planted import Motion


def run(machine: ForceMachine, trial: Motion) -> np.ndarray:
    """(T, J, 7) of `run_force_cylinders`, a row a millisecond."""
    place, speed, acceleration = (_finer(signal, KEEP) for signal in motion(machine.rooms, trial))
    axes = machine.axes.copy()
    axes["jump_from"] = np.minimum(axes["jump_from"] * trial.seconds, 1e9)  # given as a share of the trial
    kept = np.empty((len(place) // KEEP, len(machine.names), 7))
    run_force_cylinders(
        axes,
        machine.loops,
        np.array(machine.supply),
        place,
        speed,
        acceleration,
        lost_frames(machine, trial, len(place)),
        dead_times(machine)[:, 0].copy(),
        np.full(len(axes), machine.logger.resolution),
        STEP,
        round(1.0 / machine.logger.host_hz / STEP),
        KEEP,
        place[0].copy(),
        kept,
    )
    return kept


def _finer(signal: np.ndarray, times: int) -> np.ndarray:
    """(T · times, J) with straight lines between the rows."""
    rows = np.arange(len(signal) * times) / times
    return np.column_stack([np.interp(rows, np.arange(len(signal)), column) for column in signal.T])


def record(machine: ForceMachine, trial: Motion) -> dict[str, np.ndarray]:
    """The columns of a trial as the machine's logger writes them; a joint that turns in rad and N·m."""
    kept, log, rng = run(machine, trial), machine.logger, np.random.default_rng([trial.seed, 99])
    time = sample_times(trial.seconds, log.rate_hz, log.jitter, rng)
    fine = np.arange(len(kept)) * KEPT_S
    row = np.clip(np.floor(time / KEPT_S + 1e-6).astype(np.int64), 0, len(kept) - 1)
    found: dict[str, np.ndarray] = {"time": time}
    for j, name in enumerate(machine.names):
        radius = machine.radius_of(j)
        found |= logged_motion(machine, j, kept, time, 0.002, rng)
        found[f"joint/{name}/effort_command"] = kept[row, j, 4] * radius
        force = np.interp(time, fine, kept[:, j, 6]) + rng.normal(0.0, machine.effort_noise[j], len(time))
        found[f"joint/{name}/effort"] = force * radius
        if log.pressures:
            for channel, column in (("pressure_a", 2), ("pressure_b", 3)):
                pressure = np.interp(time, fine, kept[:, j, column])
                found[f"joint/{name}/{channel}"] = np.abs(pressure + rng.normal(0.0, log.pressure_noise, len(time)))
    if log.supply:
        found["supply/pressure"] = np.interp(time, fine, kept[:, 0, 5]) + rng.normal(0.0, log.pressure_noise, len(time))
    return found
