"""Extra dry friction near zero speed."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import EFFORT, FRICTION, NONE, SLIDING, VELOCITY, Effect, Parameter

EFFECT = Effect(
    name="stribeck_friction",
    layer="actuator",
    stage="output",
    parameters=(
        Parameter("static_nm", "N·m", EFFORT, 0.0, 20.0, (0.1,), anew=FRICTION),
        Parameter("velocity_rad_s", "rad/s", VELOCITY, 0.02, 1.0, (0.1, 0.4), counts=False, neutral=1.0, anew=SLIDING),
        Parameter("exponent", "1", NONE, 0.3, 2.0, (1.0,), counts=False, neutral=1.0, anew=SLIDING),
    ),
    meaning="extra friction near zero speed",
    source="Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30, 1994: exponential Stribeck curves, exponents 0.5 to 2",
    experiment="very slow motion with many reversals",
    effort_sources=("load_cell",),
)


@njit(cache=True, nogil=True, inline="always")
def sticking(speed: float, velocity: float, exponent: float) -> float:
    """Share of the extra friction torque that is there at a joint speed."""
    return np.exp(-((abs(speed) / velocity) ** exponent))
