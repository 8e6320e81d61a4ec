"""The oil column changes with the position, and with it the stiffness of the joint.

Chambers of unequal volume are not driven alike: where their mean pressure is not half the supply, for leakage or because
the supply sags, one direction passes more oil than the other. That unevenness belongs to the effect, within limits. The
mean pressure follows a sagging supply only as fast as the valve exchanges the oil. Soft oil that is less compressed is
displaced with less pressure: in a chamber ṗ = β/V (Q − (1 + p/β) V̇) with the flow Q counted in oil without pressure.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import COMMAND, NONE, Block, Constants, Effect, Law, Parameter, Search, State

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


@njit(cache=True, nogil=True, inline="always")
def mixed(mean: float, loss: float, raw_command: float, raw_position: float, exchange: float, dt: float) -> float:
    """`exchanged` by the opening that the error of the position asks for, whatever bends that on the way."""
    return exchanged(mean, loss, raw_command - raw_position, exchange, dt)


@njit(cache=True, nogil=True, inline="always")
def stiffened(stiff: float, position: float, middle: float, slope: float) -> float:
    """Stiffness relative to that in the middle, beside what else changes it."""
    return stiff * stiffness(slope, position - middle)


@njit(cache=True, nogil=True, inline="always")
def drained(loss: float) -> float:
    """Mean pressure of the chambers after a long time at a loss of supply pressure."""
    return -loss


EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    parameters=(
        Parameter("slope_per_rad", "1/rad", Search(NONE, -4.0, 4.0, (0.3, -0.3))),  # bounds the unevenness
        Parameter("unevenness", "1", Search(NONE, -0.2, 0.2, (0.0,), counts=False)),
        Parameter("exchange", "command·s", Search(COMMAND, 0.0, 100.0, (1.0,), counts=False, free=False), inverse=True),
        Parameter("compression", "1", Search(NONE, 0.0, 0.6, (0.0,), counts=False, free=False)),
    ),
    meaning="the gain changes with the position, as the oil volumes do",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
    advice="Schedule the gain with the position, or keep the slope in the simulator so that the policy learns it.",
    blocks=(
        Block(
            mixed,
            ("mean", "loss", "raw_command", "raw_position", "exchange", "dt"),
            ("mean",),
            ("slope_per_rad",),
        ),
        Block(stiffened, ("stiff", "position", "middle", "slope_per_rad"), ("stiff",), ("slope_per_rad",)),
        Block(displaced, ("speed", "mean", "compression"), ("speed",), ("mean",)),
    ),
    states=(State("mean", Law(drained, ("loss",))),),
    constants=(
        Constants(("uneven",), uneven, ("slope_per_rad", "unevenness"), when=("slope_per_rad",)),
        Constants(("lean",), lean, ("slope_per_rad",)),
    ),
)
