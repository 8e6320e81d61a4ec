"""The supply pressure sags with the flow that all joints take together, and recovers."""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import SECOND, SLOWNESS, SUPPLY, Effect, Parameter

EFFECT = Effect(
    name="supply_droop",
    layer="actuator",
    stage="core",
    parameters=(
        Parameter("droop", "s/rad", SLOWNESS, 0.0, 1.0, (0.05, 0.15), anew=SUPPLY),
        Parameter("recovery_s", "s", SECOND, 0.003, 5.0, (0.03, 0.3), counts=False, neutral=0.1, anew=SUPPLY),
    ),
    meaning="pump pressure sags with the flow of all joints; relative loss per rad/s of total speed",
    source="Merritt, Hydraulic Control Systems, 1967: supply with accumulator, first order",
    experiment="all joints fast at the same time, then one joint alone",
    machine=True,
    least_joints=2,
)


@njit(cache=True, nogil=True, inline="always")
def sag(loss: float, demand: float, droop: float, share: float) -> float:
    """Relative pressure loss after one sample under the flow `demand`, counted as a total joint speed, rad/s."""
    return loss + share * (droop * demand - loss)
