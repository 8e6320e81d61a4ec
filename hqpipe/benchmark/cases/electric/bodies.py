"""Mechanisms as MJCF text: pendulums beside each other, and serial arms of hinges and slides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

GRAVITY = 9.81  # m/s²
STICKING = (
    "0.9999 0.9999 0.001 0.5 2"  # impedance of dry friction, so stiff that a held joint creeps by less than 1 µrad/s
)
SETTLING = 0.004  # s, in which a slip below the friction limit dies out; assumption: below any logged sample
DENSITY_RADIUS = 0.005  # m, radius of the bars that carry loads; thin, so that a stated mass and lever tell the inertia


@dataclass(frozen=True)
class Link:
    """One joint and what it moves.

    Attributes:
        axis: of the joint, in the frame of the link before it. slides: the joint is prismatic.
        length: m, to the next joint, or of the bar. bar_mass: kg, even along the bar.
        load_mass: kg, a point mass at the end of the bar. armature: kg·m² of motor and gears, seen at the joint.
    """

    axis: tuple[float, float, float]
    length: float
    bar_mass: float
    load_mass: float
    armature: float
    slides: bool = False


def _body(link: Link, name: str, at: tuple[float, float, float], inner: str) -> str:
    kind = "slide" if link.slides else "hinge"
    axis = " ".join(f"{value:g}" for value in link.axis)
    end = f"0 0 {-link.length:.9g}"
    load = f'<geom type="sphere" size="0.005" pos="{end}" mass="{link.load_mass:.9g}"/>' if link.load_mass > 0 else ""
    return (
        f'<body pos="{at[0]:.9g} {at[1]:.9g} {at[2]:.9g}">'
        f'<joint name="{name}" type="{kind}" axis="{axis}" armature="{link.armature:.9g}" frictionloss="1e-9" '
        f'solreffriction="{SETTLING} 1" solimpfriction="{STICKING}"/>'
        f'<geom type="capsule" size="{DENSITY_RADIUS}" fromto="0 0 0 {end}" mass="{link.bar_mass:.9g}"/>{load}{inner}</body>'
    )


def _model(bodies: str, timestep: float) -> str:
    return (
        f'<mujoco><option timestep="{timestep:g}" gravity="0 0 {-GRAVITY}" integrator="implicitfast">'
        f'<flag contact="disable"/></option><worldbody>{bodies}</worldbody></mujoco>'
    )


def pendulums(links: Sequence[Link], timestep: float) -> str:
    """Each joint on a frame of its own; at 0 rad its bar hangs straight down."""
    bodies = "".join(_body(link, f"j{n}", (0.0, float(n), 0.0), "") for n, link in enumerate(links))
    return _model(bodies, timestep)


def serial_arm(links: Sequence[Link], timestep: float) -> str:
    """Each link hangs on the end of the one before it; at 0 rad all hang straight down."""
    inner = ""
    for n in range(len(links) - 1, -1, -1):
        place = (0.0, 0.0, -links[n - 1].length if n else 0.0)
        inner = _body(links[n], f"j{n}", place, inner)
    return _model(inner, timestep)
