"""Friction in proportion to the speed, between the hydraulics and the load cell."""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import DAMPING, POSITION, TORQUE, Effect, Parameter

EFFECT = Effect(
    name="viscous_friction",
    layer="actuator",
    stage="output",
    parameters=(Parameter("nm_s_per_rad", "N·m·s/rad", DAMPING, 0.0, 20.0, (0.05, 0.5)),),
    meaning="friction in proportion to speed",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003",
    experiment="constant-speed motion at several speeds",
    modes=(POSITION, TORQUE),
    effort_sources=("load_cell",),
)


@njit(cache=True, nogil=True, inline="always")
def viscous(speed: float, damping: float) -> float:
    """Friction torque at a joint speed."""
    return damping * speed
