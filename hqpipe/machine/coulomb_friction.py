"""Dry friction between the hydraulics and the load cell.

It rubs on the piston, which rod and chain, a spring of stiffness K_t, connect to the joint. While the piston sticks, the torque
x at the load cell changes by −K_t Δq alone. With the torque τ in front of the friction F z = τ − x, that is a change of its
direction z by (Δτ + K_t Δq)/F, until it slips at z = ± 1: the reset integrator of Haessig and Friedland (1991), Dahl's
model with the exponent 0. On a slack chain x stays 0, and F z changes by what the oil's torque does, Δτ + K Δq with the
stiffness K that τ has. `presliding_rad` is F/K_t. A sign of the measured speed would be noise at rest. The friction is
`friction_nm` + `asymmetry_nm` while the position rises and `friction_nm` − `asymmetry_nm` while it falls.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import ANGLE, EFFORT, Block, Effect, Parameter, Search, State
from hqpipe.machine.sums import added

UNEVEN = 0.5  # of the friction, by which directions may differ: more is an offset, which has its own name; assumption


@njit(cache=True, nogil=True, inline="always")
def coulomb(turned: float, friction: float, asymmetry: float) -> float:
    """Friction torque at a direction of the friction, uneven within limits."""
    most = UNEVEN * friction
    return friction * turned + min(max(asymmetry, -most), most) * abs(turned)


@njit(cache=True, nogil=True, inline="always")
def strained(velocity: float, dt: float, presliding: float) -> float:
    """By how much the travel of a sample turns the direction of a friction that sticks."""
    return velocity * dt / presliding


@njit(cache=True, nogil=True, inline="always")
def turn(
    turned: float,
    before: float,
    wound: float,
    grip: float,
    strain: float,
    half: float,
    oil: float,
    speed: float,
    dt: float,
) -> float:
    """Direction of the friction one sample later, −1 … 1, when the torque in front has changed from `before` to `wound`, N·m.

    Args:
        grip: most that friction can hold, N·m. strain: of `strained`. half: torque that takes up half of a chain's slack,
            N·m. oil, speed: stiffness, N·m/rad, and speed that the oil feels, rad/s.
    """
    if grip <= 0.0:
        return turned
    if abs(before - grip * turned) < half:
        # On a slack chain the oil alone turns it; the travel of the joint, which τ counts, is added back.
        strain = oil * speed * dt / grip
    return min(max(turned + (wound - before) / grip + strain, -1.0), 1.0)


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
    source="Haessig & Friedland, J. Dyn. Sys. Meas. Control 113, 1991: reset integrator; Jelali & Kroll, Hydraulic "
    "Servo-systems, 2003",
    experiment="slow constant-speed motion in both directions",
    advice="Simulate it, and feed it forward with the sign of the wanted speed; if it has grown, look at seals, "
    "bearings and chain tension.",
    shows_as=("friction",),
    effort_sources=("load_cell",),
    blocks=(
        Block(strained, ("velocity", "dt", "presliding_rad"), ("strain",), ("grip",)),
        Block(added, ("grip", "friction_nm"), ("grip",), ("friction_nm",)),
        Block(
            turn,
            ("turned", "before", "wound", "grip", "strain", "half", "oil", "speed", "dt"),
            ("turned",),
            ("grip",),
        ),
        Block(rubbed, ("lost", "turned", "friction_nm", "asymmetry_nm"), ("lost",), ("friction_nm",)),
    ),
    states=(State("turned", moved_by="strain"),),
    common=True,
)
