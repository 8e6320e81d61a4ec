"""Closed-loop data of known k1 … k4, made by a plain numpy loop that shares no code with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

RADIUS = 0.06
TRUTH = {"k1": 1.5e5, "k2": 0.05, "k3": 6.0e3, "k4": 6.0}
DT = 1e-3
INERTIA = 6.0  # kg·m²
DAMPING = 15.0  # N·m·s/rad
LOAD = 120.0  # N·m, constant
POLICY_STEPS = 10  # the target is held for 10 ms


def simulate(seconds, joints, noise, seed, truth=TRUTH, motion=0.35, knocks=400.0):
    """Independent joints that follow a random target and are knocked about.

    Returns:
        time (T,), and q_des, q, qd, measured torque (T, joints).
    """
    rng = np.random.default_rng(seed)
    samples = int(seconds / DT)
    k1, k2, k3, k4 = truth.values()
    t = np.arange(samples) * DT
    rates, phases = rng.uniform(0.5, 4.0, (4, joints)), rng.uniform(0, 2 * np.pi, (4, joints))
    smooth = sum(np.sin(2 * np.pi * rates[i] * t[:, None] + phases[i]) for i in range(4)) * motion / 4
    target = np.repeat(smooth[::POLICY_STEPS], POLICY_STEPS, axis=0)[:samples]
    knock = np.zeros((samples, joints))
    for _ in range(int(seconds * 2)):
        start, length = rng.integers(0, samples - 80), rng.integers(20, 80)
        knock[start : start + length] += knocks * rng.normal(size=joints)
    q, qd, torque = smooth[0].copy(), np.zeros(joints), np.zeros(joints)
    log = np.empty((3, samples, joints))
    for k in range(samples):
        log[:, k] = q, qd, torque
        error = target[k] - q
        following = (
            k1 * RADIUS**2 * error
            + (1 - k2) * torque
            - k3 * RADIUS**2 * qd
            + k4 * RADIUS * error * np.maximum(-torque * np.sign(error), 0.0)
        )
        qd = qd + DT * (torque - DAMPING * qd - LOAD + knock[k]) / INERTIA
        q = q + DT * qd
        torque = following
    return t, target, log[0], log[1], log[2] + noise * rng.normal(size=(samples, joints))


def log_set(trials, splits, joints=None):
    """Wrap simulated trials as a log set in memory."""
    names = joints or tuple(f"joint{j}" for j in range(trials[0][1].shape[1]))
    wrapped = []
    for i, ((t, target, q, qd, torque), split) in enumerate(zip(trials, splits, strict=True)):
        trajectory = Trajectory(t, names, q, qd, effort=torque, position_command=target)
        wrapped.append(Trial(f"trial_{i}.parquet", split, None, trajectory))
    return LogSet(
        path=Path("synthetic"),
        sha256="",
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="position",
        effort_source="pressure",
        rate_hz=1 / DT,
        joints=names,
        trials=tuple(wrapped),
    )
