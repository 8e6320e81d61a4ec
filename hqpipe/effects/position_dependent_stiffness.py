"""The oil column changes with the position, and with it the stiffness of the joint.

Chambers of unequal volume are not driven alike: their mean pressure moves with the load and the supply, away from half
the supply, and then one direction passes more oil than the other. That unevenness belongs to the effect, within limits.
"""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import NONE, POSITION, TORQUE, Effect, Parameter

EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    stage="core",
    parameters=(
        Parameter("slope_per_rad", "1/rad", NONE, -4.0, 4.0, (0.3, -0.3)),
        Parameter("unevenness", "1", NONE, -0.2, 0.2, (0.0,), counts=False, yields_to=("direction_asymmetry",)),
    ),
    meaning="chamber volume changes with q: change of torque × (1 + slope · (q − mean q)); |unevenness| ≤ |slope| · 0.1 rad",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
    modes=(POSITION, TORQUE),
)

LEAST = 0.05  # of the stiffness at mid position, so that no position makes it vanish; assumption
LEVER = 0.1  # rad: length of a chamber, about 1 rad, times how far the mean pressure strays, in supply pressures; assumption


@njit(cache=True, nogil=True, inline="always")
def stiffness(slope: float, offset: float) -> float:
    """Relative stiffness at `offset` rad from the middle."""
    return max(1.0 + slope * offset, LEAST)


@njit(cache=True, nogil=True, inline="always")
def uneven(slope: float, unevenness: float) -> float:
    """Share by which an opening that raises the torque passes more oil, and the other less."""
    most = LEVER * abs(slope)
    return min(max(unevenness, -most), most)
