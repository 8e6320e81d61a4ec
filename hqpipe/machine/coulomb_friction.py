"""Dry friction between the hydraulics and the load cell.

The direction of the friction is a state of its own: it turns round over a small presliding distance, and while the joint
rests it holds against what the hydraulics change. A sign of the measured speed would be noise at rest.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import ANGLE, EFFORT, FRICTION, SLIDING, Effect, Parameter

EFFECT = Effect(
    name="coulomb_friction",
    layer="actuator",
    stage="output",
    parameters=(
        Parameter("friction_nm", "N·m", EFFORT, 0.0, 20.0, (0.05, 0.2), anew=FRICTION),
        Parameter("asymmetry_nm", "N·m", EFFORT, -10.0, 10.0, (0.0,), counts=False, anew=FRICTION),
        Parameter("presliding_rad", "rad", ANGLE, 5e-5, 0.3, (0.001,), counts=False, neutral=1e-3, anew=SLIDING),
    ),
    meaning="dry friction: friction + asymmetry when q rises, friction − asymmetry when it falls; asymmetry ≤ friction/2",
    source="Dahl, Aerospace Corp. TOR-158, 1968: presliding; Jelali & Kroll, Hydraulic Servo-systems, 2003",
    experiment="slow constant-speed motion in both directions",
    effort_sources=("load_cell",),
)


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
