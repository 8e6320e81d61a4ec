"""Legs that trot, of known k1 … k4: closed-loop data with impacts and sensors, by a loop that shares no code with the package.

Every joint is an experiment of its own: command, impacts, disturbances and noise of no two have anything in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hydraulic_truth import DT, RADIUS, TRUTH

POLICY_STEPS = 10  # the target is held for 10 ms
INERTIA, DAMPING = 6.0, 15.0  # kg·m², N·m·s/rad; with k1 … k4 of `TRUTH` a position loop of 40 ms
STANCE = 180.0  # N·m of body weight while the foot is down
BLOW, BLOW_S = (200.0, 900.0), (0.02, 0.06)  # N·m and s; touch-downs and stumbles
PUSH, PUSH_S = 60.0, 0.3  # N·m, and s over which it is correlated; what else pushes a leg
LIMIT = 2000.0  # N·m


@dataclass(frozen=True)
class Sensors:
    """Standard deviations of white noise, and a torque disturbance that the model does not know.

    Attributes:
        torque: N·m. position: rad, besides the encoder's steps. velocity: rad/s.
        resolution: of the encoder, rad.
        drift: N·m of an autocorrelated part of the measured torque (seal friction, hoses, electronics).
        drift_s: its correlation time, s.
        ripple: N·m that come on in every sample within the actuator, as by the supply, and drive the joint; as correlated.
    """

    torque: float = 4.0
    position: float = 2e-5
    velocity: float = 0.01
    resolution: float = 4.8e-5
    drift: float = 8.0
    drift_s: float = 0.03
    ripple: float = 0.0


def trot(
    seconds: float,
    joints: int,
    seed: int | Sequence[int],
    sensors: Sensors | None = None,
    truth: np.ndarray | None = None,
):
    """Simulate `joints` unrelated joints of coefficients `truth` (4,) or (4, joints), else of `TRUTH`.

    Returns:
        time (T,), and q_des, q, qd, torque (T, joints) as they are logged; see `hydraulic_truth.log_set`.
    """
    sensors = sensors or Sensors()
    rng = np.random.default_rng(seed)
    samples = round(seconds / DT)
    t = np.arange(samples) * DT
    target, stance = _gait(t, joints, rng)
    load = STANCE * stance + _coloured(samples, joints, PUSH, PUSH_S, rng) + _blows(t, joints, rng)
    ripple = np.zeros_like(target)
    if sensors.ripple:
        ripple = _coloured(samples, joints, sensors.ripple, sensors.drift_s, rng)
    q, qd, torque = _run(target, load, ripple, list(TRUTH.values()) if truth is None else truth)
    measured = torque + sensors.torque * rng.normal(size=torque.shape)
    measured += _coloured(samples, joints, sensors.drift, sensors.drift_s, rng)
    q = sensors.resolution * np.round((q + sensors.position * rng.normal(size=q.shape)) / sensors.resolution)
    return t, target, q, qd + sensors.velocity * rng.normal(size=qd.shape), measured


def _gait(t: np.ndarray, joints: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(T, J) target, rad, held for a policy step, and 1 while the foot is down."""
    rate, phase = rng.uniform(1.3, 2.0, joints), rng.uniform(0.0, 1.0, joints)
    cycle = np.cumsum(rate * (1.0 + _coloured(len(t), joints, 0.1, 1.0, rng)), axis=0) * DT + phase
    swing = rng.uniform(0.15, 0.3, joints) * np.sin(2 * np.pi * cycle)
    lift = rng.uniform(0.05, 0.15, joints) * np.maximum(np.sin(4 * np.pi * cycle), 0.0)
    steps = _coloured(len(t), joints, 0.04, 0.1, rng)  # what a policy corrects
    smooth = swing + lift + np.stack([np.convolve(s, np.full(50, 0.02), "same") for s in steps.T], axis=1)
    return np.repeat(smooth[::POLICY_STEPS], POLICY_STEPS, axis=0)[: len(t)], (cycle % 1.0 < 0.6).astype(float)


def _blows(t: np.ndarray, joints: int, rng: np.random.Generator) -> np.ndarray:
    """(T, J) N·m; two half sine waves a second, of either sign."""
    found = np.zeros((len(t), joints))
    for j in range(joints):
        for start in rng.uniform(0.0, t[-1], int(2 * t[-1])):
            share = (t - start) / rng.uniform(*BLOW_S)
            size = rng.uniform(*BLOW) * rng.choice((-1.0, 1.0))
            inside = (share > 0.0) & (share < 1.0)
            found[inside, j] += size * np.sin(np.pi * share[inside])
    return found


def _coloured(samples: int, joints: int, size: float, time_s: float, rng: np.random.Generator) -> np.ndarray:
    """(T, J) first-order autoregression of standard deviation `size`."""
    keep = np.exp(-DT / time_s)
    kick = rng.normal(size=(samples, joints)) * size * np.sqrt(1.0 - keep**2)
    kick[0] = size * rng.normal(size=joints)
    for k in range(1, samples):
        kick[k] += keep * kick[k - 1]
    return kick


def _run(
    target: np.ndarray, load: np.ndarray, ripple: np.ndarray, truth: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T, J) q, qd and torque of eq. (7) of the paper under a load."""
    k1, k2, k3, k4 = truth
    q, qd, torque = target[0].copy(), np.zeros(target.shape[1]), np.zeros(target.shape[1])
    log = np.empty((3, *target.shape))
    for k in range(len(target)):
        log[:, k] = q, qd, torque
        error = target[k] - q
        opposed = np.maximum(-torque * np.sign(error), 0.0)
        following = k1 * RADIUS**2 * error + (1 - k2) * torque - k3 * RADIUS**2 * qd + k4 * RADIUS * error * opposed
        qd = qd + DT * (torque - DAMPING * qd - load[k]) / INERTIA
        q = q + DT * qd
        torque = np.clip(following + ripple[k], -LIMIT, LIMIT)
    return log[0], log[1], log[2]
