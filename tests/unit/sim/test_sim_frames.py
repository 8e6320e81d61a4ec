"""Conversions between centre of mass and link frame, against matrices."""

from __future__ import annotations

import numpy as np

from hqpipe.sim.frames import base_from_com, com_from_base, foot_from_com, multiply, rotate


def quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def matrix(q: np.ndarray) -> np.ndarray:
    x, y, z, w = q
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def test_rotate_and_multiply_are_matrix_products():
    rng = np.random.default_rng(0)
    a, b, v = quaternion(rng), quaternion(rng), rng.normal(size=3)
    rotated, product = np.empty(3), np.empty(4)
    rotate(a, v, rotated)
    multiply(a, b, product)
    np.testing.assert_allclose(rotated, matrix(a) @ v)
    np.testing.assert_allclose(matrix(product), matrix(a) @ matrix(b))


def test_base_and_com_convert_back_and_forth():
    rng = np.random.default_rng(1)
    inertial = np.concatenate((rng.normal(size=3), quaternion(rng)))
    position, orientation, linear, angular = rng.normal(size=3), quaternion(rng), rng.normal(size=3), rng.normal(size=3)
    pose, twist = np.empty(7), np.empty(6)
    com_from_base(inertial, position, orientation, linear, angular, pose, twist)
    turn = matrix(orientation)
    np.testing.assert_allclose(pose[:3], position + turn @ inertial[:3])
    np.testing.assert_allclose(twist[3:], turn @ angular)
    np.testing.assert_allclose(twist[:3], linear + np.cross(turn @ angular, turn @ inertial[:3]))
    back = [np.empty((1, n)) for n in (3, 4, 3, 3)]
    base_from_com(inertial[None], pose[None], twist[None], *back)
    for got, expected in zip(back, (position, orientation, linear, angular), strict=True):
        np.testing.assert_allclose(got[0], expected, atol=1e-12)


def test_foot_state_is_taken_at_the_link_origin():
    """The base's conversion, tested above, gives the same."""
    rng = np.random.default_rng(2)
    inertial = np.concatenate((rng.normal(size=3), quaternion(rng)))
    pose, twist = np.concatenate((rng.normal(size=3), quaternion(rng))), rng.normal(size=6)
    expected = [np.empty((1, n)) for n in (3, 4, 3, 3)]
    base_from_com(inertial[None], pose[None], twist[None], *expected)
    position, velocity = np.empty((1, 1, 3)), np.empty((1, 1, 3))
    foot_from_com(inertial[None, None], np.concatenate((pose, twist))[None, None], position, velocity)
    np.testing.assert_allclose(position[0], expected[0])
    np.testing.assert_allclose(velocity[0], expected[2])
