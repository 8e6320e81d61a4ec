"""A joint in a position loop, simulated by time stepping: the truth of the tests, which shares no code with the layer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from hqpipe.identify.model import all_parameters, positions
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

HZ, INNER = 1000, 4


def reference(seconds, seed, size=0.5, fastest=2.0):
    """Sum of sines below `fastest` Hz, so that speeds and accelerations vary."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * HZ)) / HZ
    f = rng.uniform(0.1, fastest, 6)
    return size * np.sum(np.sin(2 * np.pi * np.outer(f, t) + rng.uniform(0, 6.28, (6, 1))) / (0.5 + f[:, None]), axis=0)


def simulate(
    command, *, inertia, load=lambda q: 0.0, dry=lambda v, load: 0.0, viscous=lambda v: 0.0, kp=2000.0, kd=60.0,
    count=1e-6, position_noise=0.0, torque_noise=0.0, push=None, seed=0,
):  # fmt: skip
    """Position as measured, and torque (T,) at 1 kHz; the controller sees the measured position.

    The dry friction takes at most what stops the joint in a step, so that it sticks. The controller holds its torque for a
    sample; measured is the mean of before and after, which is at the time of the position.
    """
    rng = np.random.default_rng(seed)
    h = 1.0 / (HZ * INNER)
    q, v, seen = float(command[0]), 0.0, float(command[0])
    filtered, before, measured, torques = 0.0, 0.0, np.zeros(len(command)), np.zeros(len(command))
    for k, target in enumerate(command):
        last, seen = seen, np.round((q + position_noise * rng.standard_normal()) / count) * count
        filtered += 0.2 * ((seen - last) * HZ - filtered)
        torque = kp * (target - seen) - kd * filtered
        measured[k], torques[k] = seen, 0.5 * (torque + before)
        before = torque
        for _ in range(INNER):
            carried = load(q)
            free = v + h * (torque - carried - viscous(v) + (push[k] if push is not None else 0.0)) / inertia
            stop = h * dry(v, inertia * (free - v) / h + carried) / inertia
            v = np.sign(free) * max(abs(free) - stop, 0.0)
            q += h * v
    return measured, torques + torque_noise * rng.standard_normal(len(command))


def log_set(trials, joints=("joint",), kinds=None, channel="effort", **stated):
    """Trials of (command, position, torque), each (T,) or (T, J); the last one held out."""
    found = []
    for k, (command, position, torque) in enumerate(trials):
        command, position, torque = (np.reshape(x, (len(x), -1)) for x in (command, position, torque))
        trajectory = Trajectory(
            time=np.arange(len(position)) / HZ,
            joints=joints,
            position=position,
            velocity=np.gradient(position, 1.0 / HZ, axis=0),
            position_command=command,
            **{channel: torque},
        )
        found.append(Trial(f"{k}.parquet", "heldout" if k == len(trials) - 1 else "fit", None, trajectory, **stated))
    return LogSet(
        path=Path("logs"), sha256="", format="hqpipe-log/1", robot=None, base="fixed", control_mode="position",
        effort_source=None, rate_hz=HZ, joints=joints, trials=tuple(found), kinds=kinds or {},
    )  # fmt: skip


def fitted(model, effects):
    """Parameter → value of the bounded least squares with a normal prior, the errors (fit, held-out), and all values."""
    parameters, at = all_parameters(model), positions(model, effects)
    neutral = np.array([p.neutral for p in parameters])
    low, high = (np.array([getattr(parameters[k], side) for k in at]) for side in ("low", "high"))
    size = np.array([parameters[k].spread for k in at])
    known = np.isfinite(size)
    size = np.where(known, size, np.maximum(np.abs(neutral[at]), 1e-2))

    def full(x):
        values = neutral.copy()
        values[at] = x
        return values

    first = np.clip(neutral[at] + 0.3 * size * (np.arange(len(at)) >= len(model.base)), low, high)
    scale = max(model.noise[0], 1e-3 * float(np.std(model.fit.output)))

    def cost(x):
        return np.concatenate([model.error(full(x)) / scale, ((x - neutral[at]) / size)[known]])

    best = least_squares(cost, first, bounds=(low, high), x_scale=size)
    values = full(best.x)
    rms = tuple(float(np.sqrt(np.mean(model.error(values, held) ** 2))) for held in (False, True))
    return {parameters[k].name: float(v) for k, v in zip(at, best.x, strict=True)}, rms, values
