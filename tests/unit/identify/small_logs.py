"""Log sets in memory for the unit tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial


def trajectory(samples=600, joints=("hip", "knee"), dt=1e-3, seed=0, **changes):
    """Random but smooth signals; the effort is unrelated to any model."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * dt

    def wave(size):
        phase = rng.uniform(0, 6.28, len(joints))
        return size * np.sin(t[:, None] * rng.uniform(10, 30, len(joints)) + phase)

    channels = {
        "position": wave(0.3),
        "velocity": wave(2.0),
        "effort": wave(200.0),
        "position_command": wave(0.3),
    }
    return Trajectory(time=t, joints=tuple(joints), **(channels | changes))


def log_set(*trials, splits=None, **changes):
    splits = splits or ["fit"] * (len(trials) - 1) + ["heldout"]
    wrapped = tuple(
        Trial(f"t{i}.parquet", split, None, trial) for i, (trial, split) in enumerate(zip(trials, splits, strict=True))
    )
    fields = {
        "path": Path("logs"),
        "sha256": "",
        "format": "hqpipe-log/1",
        "robot": None,
        "base": None,
        "control_mode": "position",
        "effort_source": None,
        "rate_hz": 1000.0,
        "joints": trials[0].joints,
        "trials": wrapped,
    }
    return LogSet(**(fields | changes))
