"""The valve passes more in one direction than in the other."""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import NONE, Effect, Parameter

EFFECT = Effect(
    name="direction_asymmetry",
    layer="actuator",
    stage="command",
    parameters=(Parameter("ratio", "1", NONE, -0.95, 0.95, (0.1, -0.1)),),
    meaning="different gain when extending and retracting: flow × (1 + ratio · sgn u)",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: differential cylinders and asymmetric lands",
    experiment="motion of the same speed in both directions",
)


@njit(cache=True, nogil=True, inline="always")
def asymmetric(opening: float, ratio: float) -> float:
    """Opening × (1 + ratio · sgn opening)."""
    return opening + ratio * abs(opening)
