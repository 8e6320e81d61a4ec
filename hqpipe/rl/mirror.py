"""Left for right: the mirror image of an observation, a state and an action of a robot that is alike on both sides.

A policy whose action in the mirror image is the mirror image of its action prefers neither side, so that it does not turn or
drift by itself; and it learns from every step what to do on the other side (Abdolhosseini et al., On Learning Symmetric
Locomotion, MIG 2019, the form they call NET).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from hqpipe.errors import ConfigError
from hqpipe.rl.leg import LegGeometry
from hqpipe.rl.observation import Layout

_OTHER_SIDE = {"LF": "RF", "RF": "LF", "LH": "RH", "RH": "LH"}
_LEG = (-1.0, 1.0, 1.0)  # roll turns round, pitch and knee do not
# What the plane y = 0 does to vectors and to rates of turn; the mirrored trot is half a cycle ahead.
_SIGN = {
    "base_angular_velocity": (-1.0, 1.0, -1.0),
    "velocity_command": (1.0, -1.0, -1.0),
    "clock": (-1.0, -1.0),
    "base_linear_velocity": (1.0, -1.0, 1.0),
    "gravity": (1.0, -1.0, 1.0),
    "base_height": (1.0,),
}
_BY_JOINT = ("joint_position", "joint_velocity", "previous_target")
_BY_FOOT = ("foot_contact", "foot_height")
ALIKE = 1e-6  # m or rad: sides that differ by more are not mirror images; rounding is less


@dataclass(frozen=True, eq=False)
class Mirror:
    """image[i] = sign[i] · value[order[i]].

    Attributes:
        order: (n,) int64. sign: (n,) float32, ±1.
    """

    order: np.ndarray
    sign: np.ndarray

    def image(self, values: np.ndarray) -> np.ndarray:
        """(..., n) → (..., n)."""
        return values[..., self.order] * self.sign

    def beside(self, other: Mirror) -> Mirror:
        """Of two vectors, one behind the other."""
        order = np.concatenate([self.order, len(self.order) + other.order])
        return Mirror(order, np.concatenate([self.sign, other.sign]))


def mirror_feet(feet: Sequence[str]) -> Mirror:
    """Of one number per leg."""
    order = [list(feet).index(_OTHER_SIDE[foot]) for foot in feet]
    return Mirror(np.array(order), np.ones(len(feet), dtype=np.float32))


def mirror_joints(feet: Sequence[str]) -> Mirror:
    """Of roll, pitch and knee of every leg, leg by leg in the order of `feet`."""
    legs = mirror_feet(feet).order
    order = (3 * legs[:, None] + np.arange(3)).ravel()
    return Mirror(order, np.tile(np.array(_LEG, dtype=np.float32), len(feet)))


def mirror_layout(layout: Layout, feet: Sequence[str]) -> Mirror:
    """Of a vector that stands in `layout`."""
    parts = []
    for term in layout.terms:
        if term.name in _BY_JOINT:
            parts.append(mirror_joints(feet))
        elif term.name in _BY_FOOT:
            parts.append(mirror_feet(feet))
        else:
            parts.append(Mirror(np.arange(term.size), np.array(_SIGN[term.name], dtype=np.float32)))
    return reduce(Mirror.beside, parts)


def check_alike(robot: str, feet: Sequence[str], geometry: LegGeometry, nominal: np.ndarray) -> None:
    """Refuse a robot whose sides differ.

    Args:
        robot: name. nominal: (J,) rad.

    Raises:
        ConfigError: the legs are not LF, RF, LH and RH, or hips, thighs or the nominal pose are not their own mirror image.
    """
    if set(feet) != set(_OTHER_SIDE):
        raise ConfigError(
            f"policy.symmetric: the feet of {robot} are {', '.join(feet)}, expected {', '.join(_OTHER_SIDE)}, "
            "so that it is known which leg mirrors which",
            file="robot.yaml",
            field="feet",
            fix="name them so in robot.yaml, or set policy.symmetric to false",
        )
    legs = mirror_feet(feet).order
    sides = {
        "hips": (geometry.hip[legs] * (1.0, -1.0, 1.0), geometry.hip),
        "offsets of the thighs": (-geometry.side_offset[legs], geometry.side_offset),
        "nominal joint angles": (mirror_joints(feet).image(nominal), nominal),
    }
    for what, (image, own) in sides.items():
        if not np.allclose(image, own, atol=ALIKE):
            raise ConfigError(
                f"policy.symmetric: the {what} of {robot} differ between left and right, expected mirror images",
                file="robot.urdf",
                field="policy.symmetric",
                fix="set policy.symmetric to false",
            )
