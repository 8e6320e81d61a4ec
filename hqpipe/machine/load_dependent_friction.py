"""Friction that grows with the transmitted torque."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import FRICTION, NONE, Effect, Parameter

EFFECT = Effect(
    name="load_dependent_friction",
    layer="actuator",
    stage="output",
    parameters=(Parameter("coefficient", "1", NONE, 0.0, 0.8, (0.05,), anew=FRICTION),),
    meaning="friction grows with the transmitted torque",
    source="Duclusaud et al., arXiv 2410.08650, 2024: load-dependent friction of servo actuators",
    experiment="the same slow motion with and without a payload",
    effort_sources=("load_cell",),
)


@njit(cache=True, nogil=True, inline="always")
def load_friction(turned: float, effort: float, coefficient: float) -> float:
    """Friction torque under `effort` at a direction of the friction."""
    return coefficient * abs(effort) * turned
