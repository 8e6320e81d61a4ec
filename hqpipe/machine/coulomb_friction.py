"""Dry friction between the hydraulics and the load cell.

The direction of the friction is a state of its own: it turns round over a small presliding distance, and while the joint
rests it holds against what the hydraulics change. A sign of the measured speed would be noise at rest. It is
`friction_nm` + `asymmetry_nm` while the position rises and `friction_nm` − `asymmetry_nm` while it falls.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import ANGLE, EFFORT, Block, Effect, Parameter, Search, State
from hqpipe.machine.sums import added

UNEVEN = 0.5  # of the friction, by which directions may differ: more is an offset, which has its own name; assumption


@njit(cache=True, nogil=True, inline="always")
def direction(turned: float, travel: float, kept: float) -> float:
    """Direction of the friction, −1 … 1, after the joint went `travel` rad further (Dahl's model, exact step)."""
    aim = 1.0 if travel > 0.0 else -1.0
    return aim + (turned - aim) * kept


@njit(cache=True, nogil=True, inline="always")
def kept_after(travel: float, presliding: float) -> float:
    """Share of the friction's direction that is left after the joint went `travel` rad further."""
    return np.exp(-abs(travel) / presliding)


@njit(cache=True, nogil=True, inline="always")
def stuck(turned: float, change: float) -> float:
    """Direction of the friction while the joint rests: it takes up what the torque in front of it changes by, so that the
    torque behind it stays what the load needs (Karnopp, J. Dyn. Sys. Meas. Control 107, 1985).

    Args:
        turned: direction, −1 … 1.
        change: of the torque in front, as a share of the most that friction can hold.
    """
    return min(max(turned + change, -1.0), 1.0)


@njit(cache=True, nogil=True, inline="always")
def coulomb(turned: float, friction: float, asymmetry: float) -> float:
    """Friction torque at a direction of the friction, uneven within limits."""
    most = UNEVEN * friction
    return friction * turned + min(max(asymmetry, -most), most) * abs(turned)


@njit(cache=True, nogil=True, inline="always")
def kept_in(velocity: float, dt: float, presliding: float) -> float:
    """`kept_after` the travel of a sample."""
    return kept_after(velocity * dt, presliding)


@njit(cache=True, nogil=True, inline="always")
def turn(turned: float, before: float, inner: float, grip: float, velocity: float, kept: float) -> float:
    """Direction of the friction one sample later, when the torque in front has changed from `before` to `inner`, N·m.

    Args:
        grip: most that friction can hold, N·m. velocity: rad/s. kept: share of the direction that the travel leaves.
    """
    if grip <= 0.0:
        return turned
    return direction(stuck(turned, (inner - before) / grip), velocity, kept)


@njit(cache=True, nogil=True, inline="always")
def rubbed(lost: float, turned: float, friction: float, asymmetry: float) -> float:
    """Torque lost beside other friction, N·m."""
    return lost + coulomb(turned, friction, asymmetry)


EFFECT = Effect(
    name="coulomb_friction",
    layer="actuator",
    parameters=(
        Parameter("friction_nm", "N·m", Search(EFFORT, 0.0, 20.0, (0.05, 0.2))),
        Parameter("asymmetry_nm", "N·m", Search(EFFORT, -10.0, 10.0, (0.0,), counts=False, usual=0.01)),
        Parameter(
            "presliding_rad", "rad", Search(ANGLE, 5e-5, 0.3, (0.0003,), counts=False, beside="friction"), neutral=1e-3
        ),
    ),
    meaning="dry friction opposes every motion",
    source="Dahl, Aerospace Corp. TOR-158, 1968: presliding; Jelali & Kroll, Hydraulic Servo-systems, 2003",
    experiment="slow constant-speed motion in both directions",
    advice="Simulate it, and feed it forward with the sign of the wanted speed; if it has grown, look at seals, "
    "bearings and chain tension.",
    shows_as=("friction",),
    effort_sources=("load_cell",),
    blocks=(
        Block(kept_in, ("velocity", "dt", "presliding_rad"), ("kept",), ("grip",)),
        Block(added, ("grip", "friction_nm"), ("grip",), ("friction_nm",)),
        Block(turn, ("turned", "before", "inner", "grip", "velocity", "kept"), ("turned",), ("grip",)),
        Block(rubbed, ("lost", "turned", "friction_nm", "asymmetry_nm"), ("lost",), ("friction_nm",)),
    ),
    states=(State("turned", kept="kept"),),
    common=True,
)
