"""Chain or hose stretch: the hydraulic side moves by τ/k more than the joint.

A fit of logs has the spring in the coefficients, in series with the oil. How friction turns round tells it, see
`hqpipe.layers.actuator.link`.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import STIFFNESS, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def softened(stiff: float, oil: float, compliance: float) -> float:
    """Stiffness with a spring behind the oil, relative to that of the oil alone, beside what else changes it.

    Args:
        oil: stiffness of the oil, N·m/rad.
        compliance: rad/(N·m).
    """
    return stiff / (1.0 + oil * compliance)


EFFECT = Effect(
    name="transmission_compliance",
    layer="actuator",
    parameters=(Parameter("stiffness_nm_per_rad", "N·m/rad", Search(STIFFNESS, 0.0, 3.0, (0.1, 0.5)), inverse=True),),
    meaning="chain, hose or gear stretch under load",
    source="series elasticity; Pratt & Williamson, IROS 1995",
    experiment="a second encoder on the cylinder side, or a load cell behind the seals while the joint reverses slowly",
    advice="Stiffen hose, chain or mount, or simulate the spring; measure the position on the joint's side of it.",
    shows_as=("play",),
    multiplies=("k1", "k2", "k3", "k4"),
    turns_friction=True,
    blocks=(Block(softened, ("stiff", "oil", "stiffness_nm_per_rad"), ("stiff",), ("stiffness_nm_per_rad",)),),
)
