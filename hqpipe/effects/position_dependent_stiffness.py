"""The oil column changes with the position, and with it the stiffness of the joint.

Chambers of unequal volume are not driven alike: where their mean pressure is not half the supply, for leakage or because
the supply sags, one direction passes more oil than the other. That unevenness belongs to the effect, within limits.
"""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import COMMAND_SIDE, NONE, POSITION, TORQUE, Effect, Parameter

EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    stage="core",
    parameters=(
        Parameter("slope_per_rad", "1/rad", NONE, -4.0, 4.0, (0.3, -0.3)),
        Parameter(
            "unevenness",
            "1",
            NONE,
            -0.2,
            0.2,
            (0.0,),
            counts=False,
            yields_to=("direction_asymmetry",),
            anew=COMMAND_SIDE,
        ),
    ),
    meaning="chamber volume changes with q: change of torque × (1 + slope · (q − mean q)); |unevenness| ≤ |slope| · 0.02 rad",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
    modes=(POSITION, TORQUE),
)

LEAST = 0.05  # of the stiffness at mid position, so that no position makes it vanish; assumption
LEVER = 0.02  # rad: a quarter of a chamber's length times how far leakage moves the mean pressure, a few %; assumption
FED = 0.4  # rad: a quarter of a chamber's length as an angle, for chambers of about 1.6 rad; assumption


@njit(cache=True, nogil=True, inline="always")
def stiffness(slope: float, offset: float) -> float:
    """Relative stiffness at `offset` rad from the middle."""
    return max(1.0 + slope * offset, LEAST)


@njit(cache=True, nogil=True, inline="always")
def uneven(slope: float, unevenness: float) -> float:
    """Share by which an opening that raises the torque passes more oil, and the other less."""
    most = LEVER * abs(slope)
    return min(max(unevenness, -most), most)


@njit(cache=True, nogil=True, inline="always")
def fed(opening: float, slope: float, loss: float) -> float:
    """What passes relative to equal chambers while the supply has lost a share of its pressure: only the port that is fed
    feels that, and it is the stiffer chamber's in one direction."""
    lean = FED * slope * loss
    return 1.0 + lean if opening > 0.0 else 1.0 - lean
