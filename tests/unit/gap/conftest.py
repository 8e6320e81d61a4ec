"""Synthetic log sets with a planted error, from a plain numpy loop that shares no code with the models."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

DT = 1e-3
GAIN, LEAK, DRAG = 537.0, 0.05, 21.5  # N·m/rad, 1, N·m·s/rad per sample
INERTIA, DAMPING = 10.0, 40.0  # kg·m², N·m·s/rad

Effect = Callable[[np.ndarray, np.ndarray, float], np.ndarray]


def simulate(
    joints: int,
    seconds: float,
    seed: int,
    effect: Effect | None = None,
    noise: float = 2.0,
    drive_noise: float = 0.0,
) -> Trajectory:
    """One trial of position-controlled joints that follow a random multisine, held for 10 ms.

    Args:
        effect: (position error, velocity, time) → position error that the drive acts on, (J,).
        noise: standard deviation of the torque reading, N·m.
        drive_noise: standard deviation of a torque disturbance in every step, N·m.
    """
    rng = np.random.default_rng(seed)
    samples = round(seconds / DT)
    time = np.arange(samples) * DT
    frequency, phase = rng.uniform(0.3, 4.0, (6, joints)), rng.uniform(0, 2 * np.pi, (6, joints))
    wave = np.sin(2 * np.pi * frequency * time[:, None, None] + phase).sum(axis=1) * 0.08
    command = wave[np.arange(samples) // 10 * 10]
    position, velocity, torque = np.empty((3, samples, joints))
    q, qd, tau = wave[0].copy(), np.zeros(joints), np.zeros(joints)
    for k in range(samples):
        position[k], velocity[k], torque[k] = q, qd, tau
        error = command[k] - q
        acting = effect(error, qd, time[k]) if effect else error
        tau_next = GAIN * acting + (1 - LEAK) * tau - DRAG * qd + drive_noise * rng.standard_normal(joints)
        qd = qd + DT * (tau - DAMPING * qd) / INERTIA
        q = q + DT * qd
        tau = tau_next
    return Trajectory(
        time=time,
        joints=names(joints),
        position=position,
        velocity=velocity,
        effort=torque + noise * rng.standard_normal(torque.shape),
        position_command=command,
    )


def names(joints: int) -> tuple[str, ...]:
    return ("LFR", "LFP", "LFK", "RFR", "RFP", "RFK", "LHR", "LHP", "LHK", "RHR", "RHP", "RHK")[:joints]


def log_set_of(trials: dict[str, tuple[str, Trajectory]]) -> LogSet:
    first = next(iter(trials.values()))[1]
    return LogSet(
        path=Path("synthetic"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="position",
        effort_source="load_cell",
        rate_hz=1 / DT,
        joints=first.joints,
        trials=tuple(Trial(file, split, None, t) for file, (split, t) in trials.items()),
    )


@pytest.fixture
def make_logs() -> Callable[..., LogSet]:
    """(joints, seconds, effect, noise, …) → a log set of one fit and one held-out trial."""

    def make(joints: int = 2, seconds: float = 8.0, seed: int = 1, **kwargs) -> LogSet:
        return log_set_of(
            {
                "a.parquet": ("fit", simulate(joints, seconds, seed, **kwargs)),
                "b.parquet": ("heldout", simulate(joints, seconds, seed + 100, **kwargs)),
            }
        )

    return make
