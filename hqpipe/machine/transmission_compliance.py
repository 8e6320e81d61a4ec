"""Chain or hose stretch: the hydraulic side moves by τ/k more than the joint."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import STIFFNESS, Effect, Parameter

EFFECT = Effect(
    name="transmission_compliance",
    layer="actuator",
    stage="core",
    parameters=(Parameter("stiffness_nm_per_rad", "N·m/rad", STIFFNESS, 0.0, 3.0, (0.1, 0.5), inverse=True),),
    meaning="chain or hose stretch",
    source="series elasticity; Pratt & Williamson, IROS 1995",
    experiment="a second encoder on the cylinder side",
    modes=(),
)


@njit(cache=True, nogil=True, inline="always")
def softened(resistance: float, compliance: float, dt: float) -> float:
    """Factor on the change of torque: 1 / (1 + stiffness of the oil · compliance).

    Args:
        resistance: torque lost per sample and rad/s (k3 R²), dt times the oil's stiffness.
        compliance: rad/(N·m).
        dt: s.
    """
    return 1.0 / (1.0 + resistance / dt * compliance)
