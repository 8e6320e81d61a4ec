"""The oil column changes with the position, and with it the stiffness of the joint."""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import NONE, POSITION, TORQUE, Effect, Parameter

EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    stage="core",
    parameters=(Parameter("slope_per_rad", "1/rad", NONE, -4.0, 4.0, (0.3, -0.3)),),
    meaning="chamber volume changes with q: change of torque × (1 + slope · (q − mean q))",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
    modes=(POSITION, TORQUE),
)

LEAST = 0.05  # of the stiffness at mid position, so that no position makes it vanish; assumption


@njit(cache=True, nogil=True, inline="always")
def stiffness(slope: float, offset: float) -> float:
    """Relative stiffness at `offset` rad from the middle."""
    return max(1.0 + slope * offset, LEAST)
