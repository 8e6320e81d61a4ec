"""The controller has an integrator that the model lacks: u = e + ki ∫ e dt, the second term within ± limit."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import COMMAND, NONE, Balanced, Block, Effect, Law, Parameter, Search, State

LONGEST = 30.0  # time constants of the integrator: e has long vanished


@njit(cache=True, nogil=True, inline="always")
def integrate(integral: float, error: float, ki: float, inverse_limit: float, dt: float) -> float:
    """ki ∫ e dt after one more sample, clamped against wind-up; 0 means no limit."""
    limit = 1.0 / max(inverse_limit, 1e-300)
    return min(max(integral + ki * dt * error, -limit), limit)


@njit(cache=True, nogil=True, inline="always")
def wound_up_for(error: float, ki: float, inverse_limit: float, time: float) -> float:
    """What the integrator holds if it was switched on `time` s ago, empty, while the joint was held against its load.

    The opening that the load asks for stays, u = e + I, so that e falls by exp(−ki t) and I is what it has lost.
    """
    limit = 1.0 / max(inverse_limit, 1e-300)
    return min(max(error * np.expm1(min(ki * time, LONGEST)), -limit), limit)


@njit(cache=True, nogil=True, inline="always")
def integrated(
    opening: float, integral: float, error: float, ki: float, inverse_limit: float, dt: float
) -> tuple[float, float]:
    """Opening and integral after a sample."""
    return opening + integral, integrate(integral, error, ki, inverse_limit, dt)


@njit(cache=True, nogil=True, inline="always")
def most(inverse_limit: float) -> float:
    """Largest integral."""
    return 1.0 / max(inverse_limit, 1e-300)


EFFECT = Effect(
    name="integral_action",
    layer="actuator",
    parameters=(
        Parameter("ki", "1/s", Search(NONE, 0.0, 50.0, (0.3, 3.0))),
        Parameter("limit", "command", Search(COMMAND, 0.0, 20.0, (0.1, 1.0, 4.0), counts=False), inverse=True),
    ),
    meaning="the controller on the machine integrates its error",
    source="textbook PID; ki is the integral gain over the proportional gain",
    experiment="hold a constant load for a few seconds after a step",
    advice="Read ki and the anti-windup from the controller's settings and put them in the simulator, or switch the "
    "integrator off.",
    blocks=(
        Block(integrated, ("opening", "integral", "error", "ki", "limit", "dt"), ("opening", "integral"), ("ki",)),
    ),
    states=(State("integral", Balanced(Law(most, ("limit",)), Law(wound_up_for, ("error", "ki", "limit", "held")))),),
)
