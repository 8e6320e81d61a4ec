"""A family of slightly different robots, made from one URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, fields

import numpy as np

from hqpipe.errors import UsageError
from hqpipe.robots import RobotSpec
from hqpipe.sim.engine import FRICTION, RobotVariant


@dataclass(frozen=True)
class KinematicsRandomisation:
    """Half-ranges of uniform draws. The paper randomises the kinematics and gives no sizes, so all are assumptions.

    Attributes:
        variants: number of robots in the family; environment i gets robot i mod `variants`.
        link_length: share of every joint's distance from its parent, one draw per joint. 2 % of a 0.45 m thigh is
            9 mm: welding tolerance plus the bending of a loaded link.
        frame_offset: shift of every joint frame along each axis, m.
        frame_angle: turn of every joint frame about each axis, rad. It acts as an offset of joint zero and as a
            misaligned axis.
        mass: share of every link's mass; the inertia scales along. Hoses and oil are hard to weigh.
        com: shift of every link's centre of mass along each axis, m.
        friction: share of the ground friction, 0.8.
    """

    variants: int = 16
    link_length: float = 0.02
    frame_offset: float = 0.005
    frame_angle: float = 0.01
    mass: float = 0.05
    com: float = 0.01
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.variants < 1:
            raise UsageError(f"variants is {self.variants}, expected at least 1", field="variants")
        for f in fields(self):
            if f.name != "variants" and not 0.0 <= getattr(self, f.name) < 1.0:
                raise UsageError(f"{f.name} is {getattr(self, f.name)}, expected 0 … 1 (not 1)", field=f.name)


def robot_variants(
    robot: RobotSpec, randomisation: KinematicsRandomisation | None, seed: int
) -> tuple[RobotVariant, ...]:
    """The family of `robot`; a variant depends on the seed and its own number only."""
    urdf = robot.urdf.read_text(encoding="utf-8")
    if randomisation is None:
        return (RobotVariant(urdf),)
    made = []
    for number in range(randomisation.variants):
        rng = np.random.default_rng([seed, number])
        friction = FRICTION * (1.0 + randomisation.friction * rng.uniform(-1.0, 1.0))
        made.append(RobotVariant(vary_urdf(urdf, randomisation, rng), friction))
    return tuple(made)


def vary_urdf(urdf: str, sizes: KinematicsRandomisation, rng: np.random.Generator) -> str:
    """Draw one robot: the URDF with other joint origins, masses, inertias and centres of mass."""
    root = ElementTree.fromstring(urdf)
    for joint in root.iter("joint"):
        _vary_joint(joint, sizes, rng)
    for link in root.iter("link"):
        if (inertial := link.find("inertial")) is not None:
            _vary_inertial(inertial, sizes, rng)
    return ElementTree.tostring(root, encoding="unicode")


def _vary_joint(joint: ElementTree.Element, sizes: KinematicsRandomisation, rng: np.random.Generator) -> None:
    scale = 1.0 + sizes.link_length * rng.uniform(-1.0, 1.0)
    shift = sizes.frame_offset * rng.uniform(-1.0, 1.0, 3)
    turn = sizes.frame_angle * rng.uniform(-1.0, 1.0, 3)
    origin = _origin(joint)
    _write(origin, "xyz", scale * _read(origin, "xyz") + shift)
    if joint.get("type") != "fixed":
        _write(origin, "rpy", _read(origin, "rpy") + turn)


def _vary_inertial(inertial: ElementTree.Element, sizes: KinematicsRandomisation, rng: np.random.Generator) -> None:
    scale = 1.0 + sizes.mass * rng.uniform(-1.0, 1.0)
    shift = sizes.com * rng.uniform(-1.0, 1.0, 3)
    mass = inertial.find("mass")
    mass.set("value", repr(float(mass.get("value")) * scale))
    inertia = inertial.find("inertia")
    for key, value in inertia.attrib.items():
        inertia.set(key, repr(float(value) * scale))
    origin = _origin(inertial)
    _write(origin, "xyz", _read(origin, "xyz") + shift)


def _origin(element: ElementTree.Element) -> ElementTree.Element:
    """The <origin> of a joint or inertial, made if the URDF leaves it out."""
    origin = element.find("origin")
    return ElementTree.SubElement(element, "origin") if origin is None else origin


def _read(origin: ElementTree.Element, key: str) -> np.ndarray:
    return np.array([float(value) for value in origin.get(key, "0 0 0").split()])


def _write(origin: ElementTree.Element, key: str, values: np.ndarray) -> None:
    origin.set(key, " ".join(repr(float(value)) for value in values))
