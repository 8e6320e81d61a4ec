"""Which joints turn and which slide, and what their units are.

A log says nothing of it: the columns are the same. It is known where logset.yaml or the robot's URDF says so. Where neither
does, units are written as for joints that turn, which is what the format takes a joint for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

REVOLUTE, PRISMATIC = KINDS = ("revolute", "prismatic")
_LINEAR = {
    "rad": "m",
    "rad/s": "m/s",
    "N·m": "N",
    "N·m·s/rad": "N·s/m",
    "N·m/rad": "N/m",
    "1/rad": "1/m",
    "s/rad": "s/m",
    "kg·m²": "kg",
}
"""Unit of a joint that turns → that of one that slides."""


def unit_of(unit: str, kind: str | None) -> str:
    """A unit of a joint that turns as that of a joint of `kind`; one without angle or torque, as s, stays."""
    return _LINEAR.get(unit, unit) if kind == PRISMATIC else unit


def completed(kinds: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """Joint → kind of all joints where it is known of some: those that are not named turn. Empty where none is known."""
    return {joint: kinds.get(joint, REVOLUTE) for joint in joints} if kinds else {}


def from_urdf(types: Mapping[str, str], joints: Sequence[str]) -> dict[str, str]:
    """Joint → kind by the types of a URDF; empty unless it has all the joints.

    Args:
        types: joint → revolute, continuous, prismatic or another.
    """
    known = {"revolute": REVOLUTE, "continuous": REVOLUTE, "prismatic": PRISMATIC}
    found = {joint: known[types[joint]] for joint in joints if types.get(joint) in known}
    return found if len(found) == len(joints) else {}
