"""Analytic kinematics of a leg with roll (+x), pitch (+y) and knee (+y), read from the URDF.

With the roll joint at the origin, d the sideways offset of the thigh and l₁, l₂ the lengths of thigh and shank:

    x  = −l₁ sin p − l₂ sin(p + k)
    z' = −l₁ cos p − l₂ cos(p + k)
    y  = d cos r − z' sin r,    z = d sin r + z' cos r

The functions take the module that holds the array (numpy or torch) as `xp`, so that the environment and the exported
graph share one formula. numpy ≥ 2 and torch spell every function used here alike.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.errors import ConfigError
from hqpipe.robots import RobotSpec


@dataclass(frozen=True)
class LegGeometry:
    """Offsets of all legs, one row per leg in the order of RobotSpec.feet.

    Attributes:
        hip: (L, 3) roll joint in the base frame, m.
        side_offset: (L,) thigh against roll joint along y, m; positive to the left.
        thigh, shank: lengths l₁ and l₂, m.
        foot_radius: of the sphere that touches the ground, m.
        knee_sign: −1 if the knee angle is negative in the nominal pose, else +1.
    """

    hip: np.ndarray
    side_offset: np.ndarray
    thigh: float
    shank: float
    foot_radius: float
    knee_sign: float

    def forward(self, joints: Any, xp: ModuleType = np) -> Any:
        """Foot centres in the base frame.

        Args:
            joints: (..., L, 3) roll, pitch and knee, rad.

        Returns:
            (..., L, 3) in m.
        """
        return xp.stack(self._from_hip(joints, xp)[:3], -1) + constant(self.hip, joints, xp)

    def _from_hip(self, joints: Any, xp: ModuleType) -> tuple[Any, Any, Any, Any]:
        """(..., L) each, m: foot centres from the hip in the base frame, x, y and z, and z before the leg rolls."""
        roll, pitch, knee = joints[..., 0], joints[..., 1], joints[..., 2]
        side = constant(self.side_offset, joints, xp)
        x = -self.thigh * xp.sin(pitch) - self.shank * xp.sin(pitch + knee)
        down = -self.thigh * xp.cos(pitch) - self.shank * xp.cos(pitch + knee)
        y = side * xp.cos(roll) - down * xp.sin(roll)
        z = side * xp.sin(roll) + down * xp.cos(roll)
        return x, y, z, down

    def velocity(self, joints: Any, rates: Any, xp: ModuleType = np) -> Any:
        """Velocity of the foot centres against the trunk, in the base frame: the time derivative of `forward`.

        Args:
            joints, rates: (..., L, 3) roll, pitch and knee, rad and rad/s.

        Returns:
            (..., L, 3) in m/s.
        """
        roll, pitch, knee = joints[..., 0], joints[..., 1], joints[..., 2]
        roll_rate, pitch_rate, knee_rate = rates[..., 0], rates[..., 1], rates[..., 2]
        x, y, z, down = self._from_hip(joints, xp)
        x_rate = down * pitch_rate - self.shank * xp.cos(pitch + knee) * knee_rate
        down_rate = -x * pitch_rate + self.shank * xp.sin(pitch + knee) * knee_rate
        y_rate = -z * roll_rate - down_rate * xp.sin(roll)
        z_rate = y * roll_rate + down_rate * xp.cos(roll)
        return xp.stack((x_rate, y_rate, z_rate), -1)

    def inverse(self, feet: Any, xp: ModuleType = np) -> Any:
        """Joint angles that put the foot centres at `feet`; out of reach, the leg points there at full stretch.

        Args:
            feet: (..., L, 3) in the base frame, m; below the roll joint.

        Returns:
            (..., L, 3) roll, pitch and knee, rad.
        """
        position = feet - constant(self.hip, feet, xp)
        x, y, z = position[..., 0], position[..., 1], position[..., 2]
        side = constant(self.side_offset, feet, xp)
        down = -xp.sqrt(xp.clip(y * y + z * z - side * side, 1e-6, None))
        roll = xp.atan2(z, y) - xp.atan2(down, side)
        roll = xp.atan2(xp.sin(roll), xp.cos(roll))
        l1, l2 = self.thigh, self.shank
        cosine = (x * x + down * down - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
        knee = self.knee_sign * xp.acos(xp.clip(cosine, -1.0 + 1e-6, 1.0 - 1e-6))
        along, across = l1 + l2 * xp.cos(knee), l2 * xp.sin(knee)
        pitch = xp.atan2(across * down - along * x, -across * x - along * down)
        return xp.stack((roll, pitch, knee), -1)

    def support(self, joints: Any, xp: ModuleType = np) -> Any:
        """Joint torques that press the foot down with 1 N, −∂z/∂q: (..., L, 3) rad → (..., L, 3) N·m/N."""
        roll, pitch, knee = joints[..., 0], joints[..., 1], joints[..., 2]
        side = constant(self.side_offset, joints, xp)
        ahead = -self.thigh * xp.sin(pitch) - self.shank * xp.sin(pitch + knee)
        down = -self.thigh * xp.cos(pitch) - self.shank * xp.cos(pitch + knee)
        about_roll = down * xp.sin(roll) - side * xp.cos(roll)
        about_pitch = ahead * xp.cos(roll)
        about_knee = -self.shank * xp.sin(pitch + knee) * xp.cos(roll)
        return xp.stack((about_roll, about_pitch, about_knee), -1)


def constant(values: np.ndarray, reference: Any, xp: ModuleType = np) -> Any:
    """`values` as an array of the library `xp`, in the type of `reference`."""
    if xp is np:
        return values.astype(reference.dtype, copy=False)
    return xp.as_tensor(values, dtype=reference.dtype)


def read_leg_geometry(robot: RobotSpec) -> LegGeometry:
    """Read the offsets of roll, pitch, knee and foot from the URDF.

    Raises:
        ConfigError: a joint is missing or the legs are not built alike.
    """
    if robot.joints != tuple(f"{leg}{kind}" for leg in robot.feet for kind in "RPK"):
        raise ConfigError(
            f"{robot.folder}/robot.yaml: joints: expected roll, pitch, knee of each leg in turn",
            file=robot.folder / "robot.yaml",
            field="joints",
            fix="list <leg>R, <leg>P, <leg>K for every leg in the order of `feet`",
        )
    root = ElementTree.parse(robot.urdf).getroot()
    origin = {}
    for joint in root.iter("joint"):
        child, place = joint.find("child"), joint.find("origin")
        if child is not None and place is not None:
            vector = np.array([float(v) for v in place.get("xyz", "0 0 0").split()])
            origin[joint.get("name")] = origin[child.get("link")] = vector
    try:
        hip = np.stack([origin[f"{leg}R"] for leg in robot.feet])
        pitch = np.stack([origin[f"{leg}P"] for leg in robot.feet])
        knee = np.stack([origin[f"{leg}K"] for leg in robot.feet])
        foot = np.stack([origin[f"{leg}_foot"] for leg in robot.feet])
    except KeyError as error:
        raise ConfigError(
            f"{robot.urdf}: joint or link {error} has no origin, expected one of <leg>R, <leg>P, <leg>K and <leg>_foot",
            file=robot.urdf,
            field=str(error.args[0]),
            fix="give the joint an <origin>",
        ) from error
    planar = np.concatenate([pitch[:, [0, 2]], knee[:, :2], foot[:, :2]], axis=1)
    if np.abs(planar).max() > 1e-9 or np.ptp(knee[:, 2]) > 1e-9 or np.ptp(foot[:, 2]) > 1e-9:
        raise ConfigError(
            f"{robot.urdf}: the analytic leg expects equal straight legs, offset sideways only",
            file=robot.urdf,
            field="origin",
            fix="correct the origins of the pitch and knee joints and of the feet",
        )
    if not (knee[0, 2] < 0.0 and foot[0, 2] < 0.0):
        raise ConfigError(
            f"{robot.urdf}: thigh and shank are {-knee[0, 2]:g} and {-foot[0, 2]:g} m long, expected lengths above 0",
            file=robot.urdf,
            field="origin",
            fix="give the knee joints and the feet origins below their parents",
        )
    nominal_knee = robot.nominal_position[robot.joints.index(f"{robot.feet[0]}K")]
    return LegGeometry(
        hip=hip,
        side_offset=pitch[:, 1],
        thigh=float(-knee[0, 2]),
        shank=float(-foot[0, 2]),
        foot_radius=_foot_radius(root, robot),
        knee_sign=float(np.sign(nominal_knee)),
    )


def _foot_radius(root: ElementTree.Element, robot: RobotSpec) -> float:
    sphere = root.find(f"./link[@name='{robot.foot_links[0]}']/collision/geometry/sphere")
    if sphere is None:
        raise ConfigError(
            f"{robot.urdf}: link {robot.foot_links[0]} has no collision sphere",
            file=robot.urdf,
            field=robot.foot_links[0],
            fix="give every foot a <sphere> as its collision shape",
        )
    return float(sphere.get("radius"))


def total_mass(robot: RobotSpec) -> float:
    """Sum of the link masses in the URDF, kg."""
    root = ElementTree.parse(robot.urdf).getroot()
    return sum(float(mass.get("value")) for mass in root.iter("mass"))
