"""The oil column changes with the position, and with it the stiffness of the joint.

Chambers of unequal volume are not driven alike: where their mean pressure is not half the supply, for leakage or because
the supply sags, one direction passes more oil than the other. That unevenness belongs to the effect, within limits. The
mean pressure follows a sagging supply only as fast as the valve exchanges the oil. Soft oil that is less compressed is
displaced with less pressure: in a chamber ṗ = β/V (Q − (1 + p/β) V̇) with the flow Q counted in oil without pressure.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import COMMAND, COMMAND_SIDE, NONE, SUPPLY, Effect, Parameter

EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    stage="core",
    parameters=(
        Parameter("slope_per_rad", "1/rad", NONE, -4.0, 4.0, (0.3, -0.3), anew=COMMAND_SIDE),  # bounds the unevenness
        Parameter(
            "unevenness",
            "1",
            NONE,
            -0.2,
            0.2,
            (0.0,),
            counts=False,
            anew=COMMAND_SIDE,
        ),
        Parameter(
            "exchange",
            "command·s",
            COMMAND,
            0.0,
            100.0,
            (1.0,),
            inverse=True,
            counts=False,
            beside="supply_droop",
            anew=SUPPLY,
        ),
        Parameter("compression", "1", NONE, 0.0, 0.6, (0.0,), counts=False, beside="supply_droop"),
    ),
    meaning="chamber volume changes with q: change of torque × (1 + slope · (q − mean q)); |unevenness| ≤ |slope| · 0.02 rad",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
)

LEAST = 0.05  # of the stiffness at mid position, so that no position makes it vanish; assumption
LEVER = 0.02  # rad: a quarter of a chamber's length times how far leakage moves the mean pressure, a few %; assumption
LENGTH = 0.8  # rad: half of a chamber's length as an angle, for chambers of about 1.6 rad; assumption
MOST_LEAN = 0.9  # the other chamber is there, too; assumption


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
def displaced(velocity: float, mean: float, compression: float) -> float:
    """The speed as the oil feels it, relative to half the supply as mean pressure.

    Args:
        mean: what the chambers' mean pressure is off by from half the supply, relative to that. compression: share that the
            volume is less by at half the supply.
    """
    return velocity * (1.0 + compression * mean)


@njit(cache=True, nogil=True, inline="always")
def lean(slope: float) -> float:
    """By what share of both the chamber whose pressure raises the torque is the stiffer one."""
    return min(max(-LENGTH * slope, -MOST_LEAN), MOST_LEAN)


@njit(cache=True, nogil=True, inline="always")
def exchanged(mean: float, loss: float, opening: float, exchange: float, dt: float) -> float:
    """Mean pressure of the chambers after one sample, as what it is off by from half the supply, relative to that.

    Args:
        mean: a sample ago. loss: relative loss of supply pressure. opening: of the valve. exchange: one over the opening times
            the time in which their oil is exchanged; 0 for a mean pressure that stays.
    """
    if exchange == 0.0:
        return mean
    gained = np.sqrt(max(1.0 - 2.0 * loss - mean, 0.0)) - np.sqrt(max(1.0 + mean, 0.0))
    return mean + min(abs(opening) * exchange * dt, 1.0) * gained
