"""Logs of joints with a position loop: with planted effects, and short ones whose signals are chosen for what a test asks."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from hqpipe.identify.model import JointModel, all_parameters
from hqpipe.logs.trajectory import LogSet, Trajectory

sys.path.insert(0, str(Path(__file__).parents[3] / "recovery"))
import planted_effects as planted

DT = planted.DT


def planted_logs(*effects, **settings) -> LogSet:
    """Logs of one joint for each of `effects` (effect → parameter → value), by equations of their own."""
    return planted.logs_of(list(effects), **settings)


def neutral(model: JointModel) -> np.ndarray:
    """(P,) values of a joint without any effect."""
    return np.array([parameter.neutral for parameter in all_parameters(model)])


def changed(log_set: LogSet, change) -> LogSet:
    """The log set with `change` of each trajectory in its place."""
    return replace(log_set, trials=tuple(replace(t, trajectory=change(t.trajectory)) for t in log_set.trials))


def with_column(log_set: LogSet, channel: str, j: int, make) -> LogSet:
    """The log set with the channel of joint `j` replaced by `make` of its trajectory, (T,)."""

    def change(t: Trajectory) -> Trajectory:
        values = getattr(t, channel).copy()
        values[:, j] = make(t)
        return replace(t, **{channel: values})

    return changed(log_set, change)


def swinging(seconds: float, joints: int = 1, seed: int = 0) -> Trajectory:
    """Joints that swing by sines; their torque is no answer to the command, only a signal."""
    rng, time = np.random.default_rng(seed), np.arange(round(seconds / DT)) * DT
    rates, phases = rng.uniform(0.5, 2.0, joints), rng.uniform(0.0, 6.0, joints)
    angle = 2.0 * np.pi * rates * time[:, None] + phases
    position = 0.3 * np.sin(angle)
    return Trajectory(
        time,
        tuple(f"j{i}" for i in range(joints)),
        position,
        0.3 * 2.0 * np.pi * rates * np.cos(angle),
        effort=100.0 * np.cos(1.3 * angle) + rng.standard_normal(angle.shape),
        position_command=position + 0.02 * np.sin(2.1 * angle),
    )
