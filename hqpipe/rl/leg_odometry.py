"""Leg odometry: the velocity of the trunk from the joints of a leg whose foot stands still.

A foot at rest on the ground moves against the trunk as the ground does, so with p the contact point in the base frame

    v = −(ṗ + ω × p)

(Bloesch et al., State Estimation for Legged Robots – Consistent Fusion of Leg Kinematics and IMU, RSS 2012). The foot is a
sphere that is fixed to the shank and rolls: what rests is its lowest point, not its centre.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.rl.leg import LegGeometry


def trunk_velocities(geometry: LegGeometry, angular_velocity: Any, joints: Any, rates: Any, xp: ModuleType = np) -> Any:
    """Velocity of the trunk in the base frame as each leg gives it, if its foot stands.

    The lowest point of the foot is taken along the trunk's own vertical. A tilt of 0.05 rad changes the result by the foot's
    radius times 0.05 times the turning rate of the shank, 5 mm/s at 2 rad/s.

    Args:
        angular_velocity: (..., 3) of the trunk, rad/s, base frame.
        joints, rates: (..., L, 3) roll, pitch and knee, rad and rad/s.
        xp: numpy or torch.

    Returns:
        (..., L, 3) m/s.
    """
    x, y, z = (geometry.forward(joints, xp)[..., i] for i in range(3))
    along, aside, up = (geometry.velocity(joints, rates, xp)[..., i] for i in range(3))
    wx, wy, wz = (angular_velocity[..., i : i + 1] for i in range(3))
    roll, bend = rates[..., 0], rates[..., 1] + rates[..., 2]
    radius = geometry.foot_radius
    shank_x, shank_y = wx + roll, wy + bend * xp.cos(joints[..., 0])  # of its rotation against the ground
    along = along + wy * z - wz * y - radius * shank_y
    aside = aside + wz * x - wx * z + radius * shank_x
    up = up + wx * y - wy * x
    return -xp.stack((along, aside, up), -1)
