"""Two joints under torque control: one runs from stop to stop, the other one swings freely; kinematics alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

DT, STOP, SPEED, DRAG = 2e-3, 0.3, 0.4, 50.0  # s, m, m/s, N·s/m


def trial(seed: int, stop: float, seconds: float = 12.0) -> Trajectory:
    rng, samples = np.random.default_rng(seed), round(seconds / DT)
    time, q, side, until = np.arange(samples) * DT, 0.0, 1.0, 0.0
    position, speed, command = (np.empty(samples) for _ in range(3))
    for k in range(samples):
        if time[k] >= until:
            side, until = -side, time[k] + rng.uniform(1.8, 2.6)
        wanted = side * SPEED * (1.0 + 0.3 * np.sin(5.0 * time[k]))
        moved = min(max(q + DT * wanted, -stop), stop)
        position[k], speed[k], command[k] = q, (moved - q) / DT, 3.0 * DRAG * wanted
        q = moved
    swing = 0.5 * np.sin(2.1 * time + seed) + 0.2 * np.sin(5.3 * time)
    swing_speed = np.gradient(swing, DT)
    effort = np.column_stack([DRAG * speed, DRAG * swing_speed]) + 0.1 * rng.standard_normal((samples, 2))
    return Trajectory(
        time=time,
        joints=("ram", "swing"),
        position=np.column_stack([position, swing]) + 1e-6 * rng.standard_normal((samples, 2)),
        velocity=np.column_stack([speed, swing_speed]),
        effort=effort,
        effort_command=np.column_stack([command, 1.1 * DRAG * swing_speed]),
    )


def rest_trial(seed: int) -> Trajectory:
    """A joint that a torque lifts from one place to another and that friction and its load then hold."""
    rng, samples = np.random.default_rng(seed), round(12.0 / DT)
    time = np.arange(samples) * DT
    wave = np.clip(2.0 * np.sin(2.0 * np.pi * 0.25 * time), -1.0, 1.0)
    speed = np.gradient(wave, DT)
    effort = 100.0 + 20.0 * wave + DRAG * speed + 10.0 * np.sign(speed) + 0.5 * rng.standard_normal(samples)
    columns = {"position": wave, "velocity": speed, "effort": effort, "effort_command": effort + 0.02 * effort}
    return Trajectory(time=time, joints=("arm",), **{name: x[:, None] for name, x in columns.items()})


def of(trials: list[Trajectory]) -> LogSet:
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="torque",
        effort_source="load_cell",
        rate_hz=1.0 / DT,
        joints=trials[0].joints,
        trials=tuple(
            Trial(f"trial_{i}.parquet", "heldout" if i == len(trials) - 1 else "fit", None, t)
            for i, t in enumerate(trials)
        ),
    )


def log_set(stop: float = STOP) -> LogSet:
    return of([trial(seed, stop) for seed in (1, 2)])


def rest_log_set() -> LogSet:
    return of([rest_trial(seed) for seed in (1, 2)])
