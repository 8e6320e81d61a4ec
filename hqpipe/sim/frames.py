"""Compiled conversions between the frames that pybullet reports and those of WorldState.

pybullet speaks of the centre of mass of a link and of its principal axes; WorldState speaks of the link frame of
the URDF. Quaternions are x, y, z, w.
"""

from __future__ import annotations

import numpy as np
from numba import njit

import hqpipe.system.checked_cache  # noqa: F401 (before any function is compiled)


@njit(cache=True)
def rotate(q: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    """`out` = R(q) v; `out` may be `v`."""
    tx = 2.0 * (q[1] * v[2] - q[2] * v[1])
    ty = 2.0 * (q[2] * v[0] - q[0] * v[2])
    tz = 2.0 * (q[0] * v[1] - q[1] * v[0])
    x = v[0] + q[3] * tx + q[1] * tz - q[2] * ty
    y = v[1] + q[3] * ty + q[2] * tx - q[0] * tz
    z = v[2] + q[3] * tz + q[0] * ty - q[1] * tx
    out[0], out[1], out[2] = x, y, z


@njit(cache=True)
def multiply(a: np.ndarray, b: np.ndarray, out: np.ndarray) -> None:
    """`out` = a ∘ b, the rotation b followed by a; `out` must be neither."""
    out[0] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1]
    out[1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0]
    out[2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3]
    out[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2]


@njit(cache=True)
def conjugate(q: np.ndarray, out: np.ndarray) -> None:
    """`out` = the inverse of the unit quaternion q."""
    out[0], out[1], out[2], out[3] = -q[0], -q[1], -q[2], q[3]


@njit(cache=True)
def add_cross(a: np.ndarray, b: np.ndarray, sign: float, out: np.ndarray) -> None:
    """`out` += sign · a × b."""
    out[0] += sign * (a[1] * b[2] - a[2] * b[1])
    out[1] += sign * (a[2] * b[0] - a[0] * b[2])
    out[2] += sign * (a[0] * b[1] - a[1] * b[0])


@njit(cache=True)
def base_from_com(
    inertial: np.ndarray,
    pose: np.ndarray,
    twist: np.ndarray,
    position: np.ndarray,
    orientation: np.ndarray,
    linear: np.ndarray,
    angular: np.ndarray,
) -> None:
    """Write the base link's state from that of its centre of mass.

    Args:
        inertial: (N, 7) position and orientation of the inertial frame in the link frame.
        pose: (N, 7) inertial frame in the world.
        twist: (N, 6) linear and angular velocity of the inertial frame, world axes.
        position, orientation, linear, angular: (N, 3), (N, 4), (N, 3), (N, 3) as in WorldState, written.
    """
    inverse, lever = np.empty(4), np.empty(3)
    for n in range(pose.shape[0]):
        conjugate(inertial[n, 3:], inverse)
        multiply(pose[n, 3:], inverse, orientation[n])
        rotate(orientation[n], inertial[n, :3], lever)
        position[n] = pose[n, :3] - lever
        linear[n] = twist[n, :3]
        add_cross(twist[n, 3:], lever, -1.0, linear[n])
        conjugate(orientation[n], inverse)
        rotate(inverse, twist[n, 3:], angular[n])


@njit(cache=True)
def com_from_base(
    inertial: np.ndarray,
    position: np.ndarray,
    orientation: np.ndarray,
    linear: np.ndarray,
    angular: np.ndarray,
    pose: np.ndarray,
    twist: np.ndarray,
) -> None:
    """Inverse of `base_from_com` for one robot: (7,), (3,), (4,), (3,), (3,) → (7,), (6,)."""
    lever = np.empty(3)
    multiply(orientation, inertial[3:], pose[3:])
    rotate(orientation, inertial[:3], lever)
    pose[:3] = position + lever
    rotate(orientation, angular, twist[3:])
    twist[:3] = linear
    add_cross(twist[3:], lever, 1.0, twist[:3])


@njit(cache=True)
def foot_from_com(inertial: np.ndarray, links: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> None:
    """Write position and velocity (N, F, 3) of the foot frames.

    Args:
        inertial: (N, F, 7) position and orientation of the inertial frame in the link frame.
        links: (N, F, 13) position, orientation, linear and angular velocity of the inertial frame in the world.
    """
    inverse, orientation, lever = np.empty(4), np.empty(4), np.empty(3)
    for n in range(links.shape[0]):
        for f in range(links.shape[1]):
            row = links[n, f]
            conjugate(inertial[n, f, 3:], inverse)
            multiply(row[3:7], inverse, orientation)
            rotate(orientation, inertial[n, f, :3], lever)
            position[n, f] = row[:3] - lever
            velocity[n, f] = row[7:10]
            add_cross(row[10:], lever, -1.0, velocity[n, f])
