"""What sets a machine's body and floor apart from its URDF and the default floor, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Ground:
    """The floor.

    Attributes:
        friction: Coulomb coefficient; rubber on dry concrete 0.6–0.9 (assumption 0.8).
        stiffness: static normal stiffness of one foot contact, N/m (assumption 4e5: solid rubber foot).
        damping_ratio: of that contact.
        slope: rad, rising towards `slope_heading`.
        slope_heading: rad about world z, 0 = uphill towards +x.
        roughness: m, peak-to-valley height of random bumps.
        roughness_seed: draws the bumps.
    """

    friction: float = 0.8
    stiffness: float = 4.0e5
    damping_ratio: float = 1.0
    slope: float = 0.0
    slope_heading: float = 0.0
    roughness: float = 0.0
    roughness_seed: int = 0


@dataclass(frozen=True)
class Payload:
    """A mass fixed to a link: kg, centre in the link frame, m."""

    link: str
    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LinkChange:
    """How a real link differs from its URDF entry: ratios, and a shift of the centre of mass in m."""

    mass_scale: float = 1.0
    inertia_scale: float = 1.0
    com_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class BodyChanges:
    """Everything that sets the machine's body and floor apart from URDF and default floor."""

    ground: Ground = field(default_factory=Ground)
    payloads: tuple[Payload, ...] = ()
    links: Mapping[str, LinkChange] = field(default_factory=dict)
