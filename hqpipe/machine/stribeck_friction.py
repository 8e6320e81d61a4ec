"""Extra dry friction near zero speed."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import EFFORT, NONE, USUAL_VELOCITY, Block, Effect, Parameter, Search
from hqpipe.machine.sums import added


@njit(cache=True, nogil=True, inline="always")
def sticking(speed: float, velocity: float, exponent: float) -> float:
    """Share of the extra friction torque that is there at a joint speed."""
    return np.exp(-((abs(speed) / velocity) ** exponent))


@njit(cache=True, nogil=True, inline="always")
def stuck_more(lost: float, static: float, turned: float, slow: float) -> float:
    """Torque lost beside other friction, N·m."""
    return lost + static * turned * slow


EFFECT = Effect(
    name="stribeck_friction",
    layer="actuator",
    parameters=(
        Parameter("static_nm", "N·m", Search(EFFORT, 0.0, 20.0, (0.1,))),
        Parameter("velocity_rad_s", "rad/s", Search(USUAL_VELOCITY, 0.02, 0.5, (0.1, 0.4), counts=False), neutral=0.5),
        Parameter("exponent", "1", Search(NONE, 0.5, 2.0, (1.0,), counts=False), neutral=1.0),
    ),
    meaning="friction is larger near zero speed",
    source="Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30, 1994: exponential Stribeck curves, exponents 0.5 to 2",
    experiment="very slow motion with many reversals",
    advice="Avoid creeping below the speed found here, or add dither; without it in the simulator the policy will "
    "stick and slip on the machine.",
    shows_as=("friction",),
    effort_sources=("load_cell",),
    blocks=(
        Block(sticking, ("sliding", "velocity_rad_s", "exponent"), ("slow",), ("static_nm",)),
        Block(added, ("grip", "static_nm"), ("grip",), ("static_nm",)),
        Block(stuck_more, ("lost", "static_nm", "turned", "slow"), ("lost",), ("static_nm",)),
    ),
)
