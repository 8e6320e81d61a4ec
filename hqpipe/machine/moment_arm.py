"""A cylinder on a linkage turns its joint with a moment arm that changes with the position.

With the arm ρ(q) r, r in the middle of the motion, an oil force T/r gives the torque τ = ρ T, and the joint's speed q̇ moves the
piston by ρ r q̇. So the law holds for T with the speed ρ q̇. Near the middle ρ is

    ρ = 1 + slope (q − q̄) + curve (q − q̄)²

For a cylinder between two points at the distances a and b from the joint, ρ ∝ sin φ/√(a² + b² − 2 a b cos φ), φ the angle
between them (law of cosines); a lever has curve = −½ where it is longest. Friction takes the speed of the joint.

This is the geometry of the machine and no cause of a gap, so that it is part of the law, whatever the base model.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import Block, Effect, Law

LEAST = 0.1  # of the arm in the middle: no joint is moved through its dead centre; assumption
PARAMETERS = {"arm_slope": "1/rad", "arm_curve": "1/rad²"}


@njit(cache=True, nogil=True, inline="always")
def relative_arm(position: float, middle: float, slope: float, curve: float) -> float:
    """Moment arm over that at `middle`; position and middle: rad, slope: 1/rad, curve: 1/rad²."""
    offset = position - middle
    return max(1.0 + offset * (slope + curve * offset), LEAST)


@njit(cache=True, nogil=True, inline="always")
def at_arm(value: float, arm: float) -> float:
    """Torque of a force, or speed of the piston, both counted at the arm in the middle."""
    return value * arm


@njit(cache=True, nogil=True, inline="always")
def without_arm(torque: float, arm: float) -> float:
    """Torque that the force would give at the arm in the middle."""
    return torque / arm


MOMENT_ARM = Effect(
    name="moment_arm",
    layer="actuator",
    parameters=(),
    meaning="the moment arm changes with the position",
    source="law of cosines",
    experiment="",
    advice="",
    blocks=(
        Block(relative_arm, ("position", "middle", *PARAMETERS), ("arm",), tuple(PARAMETERS)),
        Block(at_arm, ("speed", "arm"), ("speed",), tuple(PARAMETERS)),
        Block(
            at_arm, ("measured", "arm"), ("measured",), tuple(PARAMETERS), undo=Law(without_arm, ("measured", "arm"))
        ),
    ),
)
