"""The spool follows its command with a lag, of first order or, with a damping ratio ζ, of second order with ω = 2 ζ/T."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import NONE, SECOND, Block, Constants, Derived, Effect, Parameter, Search, State

LEAST_DAMPED = 0.3  # damping ratio of a spool; below it swings as no valve is built to; assumption
ALIKE = 1e-9  # of the squared damping: two poles that are one


def natural_hz(time_constant_s: float, damping_ratio: float) -> float:
    """Natural frequency of a spool of second order, Hz; infinite without a lag."""
    return damping_ratio / (np.pi * time_constant_s) if time_constant_s > 0.0 else np.inf


SHORTEST_S = 1e-9  # far below what a fit tells from none: the lag is gone


@njit(cache=True, nogil=True, inline="always")
def lag_share(time_constant: float, dt: float) -> float:
    """Share of the way to a held target that a first-order lag goes in one sample."""
    return 1.0 - np.exp(-dt / max(time_constant, SHORTEST_S))


@njit(cache=True, nogil=True, inline="always")
def mean_share(time_constant: float, dt: float) -> float:
    """The same on average over the sample: what the flow of that sample sees."""
    if time_constant <= SHORTEST_S:
        return 1.0
    samples = time_constant / dt
    return 1.0 - samples * (1.0 - np.exp(-1.0 / samples))


@njit(cache=True, nogil=True, inline="always")
def follow(spool: float, target: float, share: float) -> float:
    """Spool position after a share of the way; the whole way leads to the target to its last bit."""
    return target + (1.0 - share) * (spool - target)


@njit(cache=True, nogil=True)
def swing(time_constant: float, springy: float, dt: float) -> tuple[float, float, float, float, float, float]:
    """What a sample of a held target leaves of a spool of second order, T²/(4ζ²) ẍ + T ẋ + x = target.

    Args:
        time_constant: T, s. springy: 1/ζ²; 0 makes it one of first order.

    Returns:
        yy, yv, vy, vv, my, mv: after the sample y = x − target is yy · y + yv · v and the speed v is vy · y + vv · v. On
        average over the sample, which is what its flow sees, y is my · y + mv · v.
    """
    inertia = 0.25 * time_constant**2 * springy
    if inertia <= SHORTEST_S**2:
        return 1.0 - lag_share(time_constant, dt), 0.0, 0.0, 0.0, 1.0 - mean_share(time_constant, dt), 0.0
    fading, square = 0.5 * time_constant / inertia, 1.0 / inertia  # half the sum of the poles, and their product
    apart = fading * fading - square
    if apart > ALIKE * square:
        root = np.sqrt(apart)
        slow, fast = np.exp(-square / (fading + root) * dt), np.exp(-(fading + root) * dt)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / root
    elif apart < -ALIKE * square:
        root, left = np.sqrt(-apart), np.exp(-fading * dt)
        even, odd = left * np.cos(root * dt), left * np.sin(root * dt) / root
    else:
        even = np.exp(-fading * dt)
        odd = even * dt
    yy, yv, vy, vv = even + fading * odd, odd, -square * odd, even - fading * odd
    mean_y = -(inertia * vy + time_constant * (yy - 1.0)) / dt
    return yy, yv, vy, vv, mean_y, -(inertia * (vv - 1.0) + time_constant * yv) / dt


@njit(cache=True, nogil=True, inline="always")
def lagged(
    opening: float, spool: float, rate: float, yy: float, yv: float, vy: float, vv: float, my: float, mv: float
) -> tuple[float, float, float]:
    """Mean opening of a sample, and position and speed of the spool behind it; the last six are those of `swing`."""
    behind = spool - opening
    return opening + my * behind + mv * rate, opening + yy * behind + yv * rate, vy * behind + vv * rate


EFFECT = Effect(
    name="valve_lag",
    layer="actuator",
    parameters=(
        Parameter("time_constant_s", "s", Search(SECOND, 0.0, 0.2, (0.004, 0.02))),
        Parameter(
            "damping_ratio",
            "1",
            Search(NONE, 0.0, 1.0 / LEAST_DAMPED**2, (1.0,), counts=False),
            inverse=True,
            squared=True,
        ),
    ),
    meaning="the valve's spool follows its command with a lag",
    derived=(Derived("natural_hz", "Hz", ("time_constant_s", "damping_ratio"), natural_hz),),
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: valve models of first and second order",
    experiment="a chirp of small amplitude up to the valve's corner frequency",
    advice="Train with the lag, and keep the policy's commands below the spool's bandwidth; dither or a higher pilot "
    "pressure makes the spool faster.",
    shows_as=("late",),
    common=True,
    blocks=(
        Block(
            lagged,
            ("opening", "spool", "rate", "yy", "yv", "vy", "vv", "my", "mv"),
            ("opening", "spool", "rate"),
            ("time_constant_s",),
            only_delays=True,
        ),
    ),
    states=(State("spool", "opening"), State("rate")),
    constants=(Constants(("yy", "yv", "vy", "vv", "my", "mv"), swing, ("time_constant_s", "damping_ratio", "dt")),),
)
