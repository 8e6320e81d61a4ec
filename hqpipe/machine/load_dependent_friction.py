"""Friction that grows with the transmitted torque."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import NONE, Block, Effect, Law, Parameter, Search

LEAST_PASSED = 0.05  # of the inner torque that friction lets pass, however large its coefficient; assumption


@njit(cache=True, nogil=True, inline="always")
def load_friction(turned: float, effort: float, coefficient: float) -> float:
    """Friction torque under `effort` at a direction of the friction."""
    return coefficient * abs(effort) * turned


@njit(cache=True, nogil=True, inline="always")
def gripped(grip: float, inner: float, coefficient: float) -> float:
    """Most that friction can hold beside other friction, N·m."""
    return grip + coefficient * abs(inner)


@njit(cache=True, nogil=True, inline="always")
def pressed(lost: float, turned: float, inner: float, coefficient: float) -> float:
    """Torque lost beside other friction, N·m."""
    return lost + load_friction(turned, inner, coefficient)


@njit(cache=True, nogil=True, inline="always")
def unpressed(inner: float, turned: float, coefficient: float) -> float:
    """Torque in front of this friction that leaves `inner` behind it, N·m."""
    return inner / max(1.0 - coefficient * turned * np.sign(inner), LEAST_PASSED)


EFFECT = Effect(
    name="load_dependent_friction",
    layer="actuator",
    parameters=(Parameter("coefficient", "1", Search(NONE, 0.0, 0.8, (0.05,))),),
    meaning="friction grows with the torque that is transmitted",
    source="Duclusaud et al., arXiv 2410.08650, 2024: load-dependent friction of servo actuators",
    experiment="the same slow motion with and without a payload",
    advice="Let friction grow with torque in the simulator; look at lubrication and alignment of gear or chain.",
    shows_as=("load friction",),
    effort_sources=("load_cell",),
    blocks=(
        Block(gripped, ("grip", "inner", "coefficient"), ("grip",), ("coefficient",)),
        Block(
            pressed,
            ("lost", "turned", "inner", "coefficient"),
            ("lost",),
            ("coefficient",),
            undo=Law(unpressed, ("inner", "turned", "coefficient")),
        ),
    ),
)
