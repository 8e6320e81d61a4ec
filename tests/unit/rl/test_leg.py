from __future__ import annotations

import numpy as np
import pytest
import torch

from hqpipe.errors import ConfigError
from hqpipe.rl.leg import read_leg_geometry, total_mass


@pytest.fixture(scope="module")
def leg(robot):
    return read_leg_geometry(robot)


def poses(robot, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    joints = rng.uniform(robot.position_lower, robot.position_upper, size=(count, 12))
    return joints.reshape(count, 4, 3)


def test_geometry_is_the_urdf_s(leg):
    np.testing.assert_allclose(leg.hip[0], [0.62, 0.26, -0.06])
    np.testing.assert_allclose(leg.side_offset, [0.12, -0.12, 0.12, -0.12])
    assert (leg.thigh, leg.shank, leg.foot_radius, leg.knee_sign) == (0.45, 0.45, 0.05, -1.0)


def test_straight_leg_points_down(leg):
    foot = leg.forward(np.zeros((4, 3)))
    np.testing.assert_allclose(foot[0], [0.62, 0.38, -0.06 - 0.9], atol=1e-12)


def test_nominal_feet_stand_at_the_nominal_height(robot, leg):
    feet = leg.forward(robot.nominal_position.reshape(4, 3))
    np.testing.assert_allclose(feet[:, 2] + robot.nominal_height, leg.foot_radius, atol=1e-3)


def test_inverse_undoes_forward(robot, leg):
    joints = poses(robot, 500)
    feet = leg.forward(joints)
    below = (feet - leg.hip)[..., 2] < -0.1
    np.testing.assert_allclose(leg.inverse(feet)[below], joints[below], atol=1e-6)


def test_out_of_reach_stretches_towards_the_point(leg):
    target = leg.hip + np.array([0.0, 0.0, -2.0]) + np.column_stack([np.zeros(4), leg.side_offset, np.zeros(4)])
    joints = leg.inverse(target)
    assert np.isfinite(joints).all()
    assert leg.forward(joints)[0, 2] == pytest.approx(leg.hip[0, 2] - 0.9, abs=1e-5)


def test_support_is_the_gradient_of_the_foot_height(robot, leg):
    joints, step = poses(robot, 20), 1e-6
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = step
        slope = (leg.forward(joints + shift) - leg.forward(joints - shift))[..., 2] / (2 * step)
        np.testing.assert_allclose(leg.support(joints)[..., axis], -slope, atol=1e-8)


def test_torch_agrees_with_numpy(robot, leg):
    feet = leg.forward(poses(robot, 50)).astype(np.float32)
    feet[..., 2] = np.minimum(feet[..., 2], -0.3)
    in_torch = leg.inverse(torch.as_tensor(feet), torch).numpy()
    np.testing.assert_allclose(in_torch, leg.inverse(feet), atol=2e-5)


def test_mass_is_that_of_the_robot(robot):
    assert total_mass(robot) == pytest.approx(208 + 4 * (9 + 12 + 5.5 + 0.8))


def test_unknown_leg_is_named(robot):
    from dataclasses import replace

    with pytest.raises(ConfigError, match="roll, pitch, knee"):
        read_leg_geometry(replace(robot, feet=("LF", "RF", "LH", "XX")))
