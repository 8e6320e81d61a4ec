"""The valve passes more in one direction than in the other.

A cylinder with a rod on one side does so too, and what the supply can lift differs with the direction as the areas do:
`areas` is (A₊ − A₋)/(A₊ + A₋), read by `hqpipe.machine.orifice_flow`. A torque sensor with an offset of that
share of the largest torque would say the same of position mode, but no sensor drifts by a tenth of its range.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import NONE, Effect, Parameter

MOST_UNEQUAL = 0.5  # a rod that leaves a third of the piston's area; larger ones are not built; assumption

EFFECT = Effect(
    name="direction_asymmetry",
    layer="actuator",
    stage="command",
    parameters=(
        Parameter("ratio", "1", NONE, -0.95, 0.95, (0.1, -0.1)),
        Parameter(
            "areas",
            "1",
            NONE,
            -MOST_UNEQUAL,
            MOST_UNEQUAL,
            (0.0,),
            counts=False,
            beside="orifice_flow",
        ),
    ),
    meaning="different gain when extending and retracting: flow × (1 + ratio · sgn u)",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: differential cylinders and asymmetric lands",
    experiment="motion of the same speed in both directions",
)


@njit(cache=True, nogil=True, inline="always")
def asymmetric(opening: float, ratio: float) -> float:
    """Opening × (1 + ratio · sgn opening)."""
    return opening + ratio * abs(opening)
