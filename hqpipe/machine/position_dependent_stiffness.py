"""The oil columns of both chambers change with the position, and with them the stiffness of the joint.

Chambers of unequal volume are not driven alike. The pressure of the smaller one changes faster, so that the mean of both moves
with the torque until the valve has exchanged the oil: where it is high, less oil is fed and more is drained. A supply that sags
is felt by the port that is fed alone, until the mean pressure has followed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import CURVE, NONE, TRAVEL, Block, Effect, Law, Parameter, Search, State

LENGTH = 0.5  # rad: two equal chambers of 1 rad each, of a joint that turns by 2 rad; assumption
LONGEST = 1.0  # rad: of a joint that turns by 4 rad, more than any leg's; assumption
LEAST = 0.05  # of `length`, so that no position empties the smaller chamber; assumption
MOST_LEAN = 0.95  # share by which one chamber is stiffer: the other is there, too; assumption
MOST_STRAYED = 0.02  # of half the supply, by which leakage to the outside moves the mean pressure; assumption


@njit(cache=True, nogil=True, inline="always")
def smaller(offset: float, slope: float, length: float) -> tuple[float, float]:
    """Joint stiffness over that in the middle, and by what share of it the chamber that raises the torque is the stiffer one.

    What both chambers have alike is counted as constant: with the position it changes in every sound joint, and to second
    order only. The rest is the smaller chamber's, and goes with one over its length.

    Args:
        offset: rad from the middle. slope: of the stiffness there, relative to it, 1/rad. length: 1/(1/a + 1/b) of the lengths
            a and b of the chambers in the middle, which are their volumes over area and moment arm, rad.
    """
    lean = min(max(-slope * length, -MOST_LEAN), MOST_LEAN)
    filled = length + (offset if lean > 0.0 else -offset)
    share = lean * length / max(filled, LEAST * length, 1e-9)  # a length of 0, as a file may have it, is no lean
    stiffness = 1.0 - abs(lean) + abs(share)
    return stiffness, share / stiffness


@njit(cache=True, nogil=True, inline="always")
def stiffened(
    stiff: float, lean: float, position: float, middle: float, slope: float, length: float
) -> tuple[float, float]:
    """Stiffness beside what else changes it, and `lean` as of `smaller`."""
    relative, lean = smaller(position - middle, slope, length)
    return stiff * relative, lean


@njit(cache=True, nogil=True, inline="always")
def exchanged(
    mean: float,
    loss: float,
    opening: float,
    effort: float,
    inverse_limit: float,
    lean: float,
    leak: float,
    even: float,
    speed: float,
    stiff: float,
    gain: float,
    oil: float,
    dt: float,
) -> float:
    """Mean pressure of the chambers after one sample, as what it is off by from half the supply, relative to that.

    The other half of the continuity equations of both chambers, whose difference is the torque. Neither pressure falls
    below that of the tank or exceeds the supply's.

    Args:
        loss: relative loss of supply pressure. inverse_limit: 1/τ_max of the orifices; where that is 0 no flow of a sample is
            worth mentioning beside the oil in the chambers, and the mean stays.
    """
    load, weight = effort * inverse_limit, 0.5 * lean
    against = load if opening > 0.0 else -load
    fed = (0.5 + weight if opening > 0.0 else 0.5 - weight) * np.sqrt(max(1.0 - 2.0 * loss - mean - against, 0.0))
    drained = (0.5 - weight if opening > 0.0 else 0.5 + weight) * np.sqrt(max(1.0 + mean - against, 0.0))
    change = gain * abs(opening) * (fed - drained) - lean * (oil * dt * speed + leak * (effort - even))
    most = max(1.0 - abs(load), 0.0)
    return min(max(mean + stiff * change * inverse_limit, -most), most)


@njit(cache=True, nogil=True, inline="always")
def settled(loss: float) -> float:
    """The same after a long time at a loss of supply pressure."""
    return -loss


EFFECT = Effect(
    name="position_dependent_stiffness",
    layer="actuator",
    parameters=(
        Parameter("slope_per_rad", "1/rad", Search(CURVE, -4.0, 4.0, (0.3, -0.3))),
        Parameter("length_rad", "rad", Search(TRAVEL, 0.1, LONGEST, (LENGTH,), counts=False), neutral=LENGTH),
        Parameter("strayed", "1", Search(NONE, -MOST_STRAYED, MOST_STRAYED, (0.0,), counts=False)),
    ),
    meaning="the gain changes with the position, as the oil volumes do",
    source="eqs. (4), (5) of the paper: bulk modulus over chamber volume",
    experiment="the same small fast motion at both ends of the joint's range",
    advice="Schedule the gain with the position, or keep the slope in the simulator so that the policy learns it.",
    blocks=(
        Block(
            stiffened,
            ("stiff", "lean", "position", "middle", "slope_per_rad", "length_rad"),
            ("stiff", "lean"),
            ("slope_per_rad",),
        ),
        Block(
            exchanged,
            (
                *("mean", "loss", "opening", "effort", "orifice_flow.effort_max_nm", "lean", "leak", "even"),
                *("speed", "stiff", "gain", "oil", "dt"),
            ),
            ("mean",),
            ("slope_per_rad",),
        ),
    ),
    states=(State("mean", Law(settled, ("loss",))),),
)
