"""A force loop on a servo valve, by small Euler steps with equations of its own; the layer under test knows none of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

LOOP = 80.0  # 1/s
SPRING = 900.0  # N·m/rad, that the motion takes per rad while the valve is shut, over the loop's gain: N·m·s/rad × 1/s
STEPS = 20  # of the integration, per sample


def motion(seconds, dt, seed):
    """(T,) position and velocity of a joint that swings by several sines."""
    rng, time = np.random.default_rng(seed), np.arange(round(seconds / dt)) * dt
    position, velocity = np.zeros(len(time)), np.zeros(len(time))
    for hertz in (0.23, 0.6, 1.3):
        phase, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.1, 0.25)
        position += size * np.sin(2.0 * np.pi * hertz * time + phase)
        velocity += size * 2.0 * np.pi * hertz * np.cos(2.0 * np.pi * hertz * time + phase)
    return position, velocity


def torque(
    command, velocity, dt, compensated=0.9, band=0.0, delay=0.0, lag=0.0, limit=np.inf, ratio=0.0, offset=0.0, leak=0.0
):
    """(T,) N·m of a loop whose opening is the error and what the speed needs, cut by the valve."""
    h, x, spool = dt / STEPS, command[0], 0.0
    found = np.empty(len(command))
    for k in range(len(command)):
        found[k] = x
        for i in range(STEPS):
            sent = command[max(int(np.floor(k + i / STEPS - delay / dt + 1e-9)), 0)]
            v = np.interp(k + i / STEPS, [k, k + 1], velocity[[k, min(k + 1, len(velocity) - 1)]])
            wanted = sent - x + offset + compensated * SPRING / LOOP * v
            spool = wanted if lag == 0.0 else spool + h / lag * (wanted - spool)
            opening = np.clip(spool, -limit, limit)
            opening = np.sign(opening) * max(abs(opening) - band, 0.0) * (1.0 + ratio * np.sign(opening))
            x += h * (LOOP * (opening - leak * x) - SPRING * v)
    return found


def log_set(dt=2e-3, seconds=10.0, noise=0.3, trials=3, stop=None, **machine):
    """A log set of one joint; the last trial is held out. `stop`: position of an end stop, where the torque is noise."""
    found = []
    for i in range(trials):
        rng = np.random.default_rng(100 + i)
        position, velocity = motion(seconds, dt, i)
        time = np.arange(len(position)) * dt
        command = (
            40.0 * np.sin(2.0 * np.pi * 0.9 * time + i)
            + np.repeat(rng.uniform(-50.0, 50.0, len(time) // 100 + 1), 100)[: len(time)]
        )
        effort = torque(command, velocity, dt, **machine)
        if stop is not None:
            touched = position > stop
            position, velocity = np.minimum(position, stop), np.where(touched, 0.0, velocity)
            command = np.where(touched, 300.0, command)
            effort = np.where(touched, 150.0 * rng.standard_normal(len(time)), effort)
        effort = effort + noise * rng.standard_normal(len(time))
        trajectory = Trajectory(
            time=time,
            joints=("hip",),
            position=position[:, None],
            velocity=velocity[:, None],
            effort=effort[:, None],
            effort_command=command[:, None],
        )
        found.append(Trial(f"trial_{i}.parquet", "heldout" if i == trials - 1 else "fit", None, trajectory))
    return LogSet(
        path=Path("force_loop"),
        sha256="0" * 64,
        format="hqpipe-log/1",
        robot=None,
        base="fixed",
        control_mode="torque",
        effort_source="pressure",
        rate_hz=1.0 / dt,
        joints=("hip",),
        trials=tuple(found),
        kinds={"hip": "revolute"},
    )
