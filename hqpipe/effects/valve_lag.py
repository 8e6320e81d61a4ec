"""The spool follows its command with a first-order lag."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.effects.effect import SECOND, Effect, Parameter

EFFECT = Effect(
    name="valve_lag",
    layer="actuator",
    stage="command",
    parameters=(Parameter("time_constant_s", "s", SECOND, 0.0, 0.2, (0.004, 0.02)),),
    meaning="spool dynamics, first order",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: first-order valve model",
    experiment="a chirp of small amplitude up to the valve's corner frequency",
)

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
    """Spool position after a share of the way."""
    return spool + share * (target - spool)
