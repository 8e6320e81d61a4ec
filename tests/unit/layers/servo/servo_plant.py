"""Log sets of a servo joint with a known truth, integrated by scipy, and a plain fit of a joint model to them."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, floor, inf, sin
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from hqpipe.identify.model import JointModel, all_parameters, positions
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

STILL = 2e-4  # rad/s, within which the plant's dry friction turns: it creeps by less than a step of a real encoder


@dataclass(frozen=True)
class Truth:
    """A joint with its drive, SI. `stall` is the torque at full duty; kp and kd close a loop where there is no duty."""

    inertia: float = 0.05
    kp: float = 40.0
    kd: float = 3.0
    gravity: float = 2.0
    friction: float = 0.0
    share: float = 0.0
    delay: float = 0.0
    gap: float = 0.0
    motor_inertia: float = 0.002
    static: float = 0.0
    stribeck: float = 1.0
    limit: float = inf
    limit_beside_drag: bool = False
    duty: bool = False
    stall: float = 4.0
    drag: float = 0.4


def command(seed: int, seconds: float, dt: float, size: float) -> np.ndarray:
    """(T,) sum of four sines between 0.2 and 2 Hz that begins at rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(round(seconds / dt)) + 1) * dt
    parts = [a * np.sin(2 * np.pi * f * t + p) for a, f, p in rng.uniform((0.5, 0.2, 0), (1, 2.0, 6), (4, 3))]
    return size * np.minimum(t / 0.5, 1.0) * np.sum(parts, axis=0) / 2.0


def simulate(truth: Truth, inputs: np.ndarray, dt: float) -> np.ndarray:
    """(T,) position of the joint under inputs that are held for a sample each, from rest."""
    drive = _two_masses if truth.gap > 0.0 else _one_mass
    time = np.arange(len(inputs)) * dt
    held = [float(u) for u in inputs]
    last = len(held) - 1
    state = np.zeros(4 if truth.gap > 0.0 else 2)
    found = solve_ivp(
        lambda t, x: drive(truth, x, held[min(max(floor((t - truth.delay) / dt + 1e-9), 0), last)]),
        (0.0, time[-1]),
        state,
        "LSODA",
        t_eval=time,
        max_step=0.5 * dt,
        rtol=1e-6,
        atol=1e-8,
    )
    assert found.success
    return found.y[0]


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _drive(truth: Truth, q: float, v: float, u: float) -> float:
    if truth.duty:
        return truth.stall * _within(u, 1.0) - truth.drag * v
    if truth.limit_beside_drag:
        return _within(truth.kp * (u - q), truth.limit) - truth.kd * v
    return _within(truth.kp * (u - q) - truth.kd * v, truth.limit)


def _one_mass(truth: Truth, x: np.ndarray, u: float) -> list[float]:
    q, v = x.tolist()
    torque = _drive(truth, q, v, u)
    dry = truth.friction + truth.share * abs(torque) + truth.static * exp(-((v / truth.stribeck) ** 2))
    return [v, (torque - truth.gravity * sin(q) - dry * _within(v / STILL, 1.0)) / truth.inertia]


def _two_masses(truth: Truth, x: np.ndarray, u: float) -> list[float]:
    """Motor and joint with a gap between them, whose flanks are springs with dampers."""
    q, v, motor, speed = x.tolist()
    torque = _drive(truth, motor, speed, u)
    twist = motor - q
    deep = twist - _within(twist, truth.gap / 2.0)
    passed = 1e4 * deep + (5.0 * (speed - v) if deep != 0.0 else 0.0)
    dry = truth.friction * _within(v / STILL, 1.0)
    return [
        v,
        (passed - truth.gravity * sin(q) - dry) / truth.inertia,
        speed,
        (torque - passed) / truth.motor_inertia,
    ]


def log_set(
    truth: Truth,
    *,
    seconds: float = 12.0,
    hz: float = 200.0,
    size: float = 0.5,
    noise: float = 2e-5,
    drive: dict[str, float] | None = None,
    load: dict[str, float] | None = None,
    kind: str | None = None,
    observed: np.ndarray | None = None,
    first: int = 0,
) -> LogSet:
    """A fit trial and a held-out trial of one joint "j"; positions with white noise of `noise` rad.

    Args:
        first: seed of the first motion.
    """
    dt = 1.0 / hz
    trials = []
    for number, split in enumerate(("fit", "heldout"), first):
        u = command(number, seconds, dt, size)
        q = simulate(truth, u, dt) + np.random.default_rng(10 + number).normal(0.0, noise, len(u))
        q = q[:, None]
        t = Trajectory(
            time=np.arange(len(u)) * dt,
            joints=("j",),
            position=q,
            velocity=differentiate(q, dt),
            position_command=None if truth.duty else u[:, None],
            duty=np.clip(u, -1.0, 1.0)[:, None] if truth.duty else None,
            velocity_source="differentiated",
            observed=observed,
        )
        stated = {"*": drive} if drive else {}
        trials.append(
            Trial(
                f"{split}_{first}.parquet" if first else f"{split}.parquet",
                split,
                None,
                t,
                None,
                stated,
                {"*": load} if load else {},
            )
        )
    return LogSet(
        Path("planted"), "", "", None, None, None, None, hz, ("j",), tuple(trials), kinds={"j": kind} if kind else {}
    )


def fit(model: JointModel, effects: tuple[str, ...]) -> dict[str, float]:
    """Least-squares values of the base and of the named effects, by "name" or "effect.name", with "rms" and "heldout"."""
    parameters = all_parameters(model)
    names = [p.name for p in model.base] + [f"{e.name}.{p.name}" for e in model.effects for p in e.parameters]
    free = positions(model, effects)
    low, high = (np.array([getattr(parameters[i], side) for i in free]) for side in ("low", "high"))
    base = np.array([parameters[i].neutral for i in free])
    scale = np.array(
        [p.spread if np.isfinite(p.spread) else abs(p.neutral) + 1e-3 for p in (parameters[i] for i in free)]
    )
    values = np.array([p.neutral for p in parameters])
    added = [i for i, at in enumerate(free) if at >= len(model.base)]
    rounds = max([len(parameters[free[i]].starts) for i in added] or [0]) or 1
    best = None
    for turn in range(rounds):
        start = base.copy()
        for i in added:
            p = parameters[free[i]]
            start[i] = p.starts[min(turn, len(p.starts) - 1)] if p.starts else p.neutral + 0.5 * p.spread

        def error(z: np.ndarray) -> np.ndarray:
            values[free] = np.clip(z * scale, low, high)
            return model.error(values)

        start = np.clip(start / scale, low / scale + 1e-12, high / scale)
        found = least_squares(
            error, start, bounds=(low / scale - 1e-9, high / scale + 1e-9), diff_step=1e-4, max_nfev=60
        )
        if best is None or found.cost < best.cost:
            best = found
    values[free] = np.clip(best.x * scale, low, high)
    result = {names[at]: float(values[at]) for at in free}
    result["rms"] = float(np.sqrt(np.mean(model.error(values) ** 2)))
    result["heldout"] = float(np.sqrt(np.mean(model.error(values, True) ** 2)))
    return result
