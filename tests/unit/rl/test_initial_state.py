from __future__ import annotations

import numpy as np

from hqpipe.rl.config import RandomisationConfig
from hqpipe.rl.initial_state import UNEVEN, random_state, trial_state
from hqpipe.rl.leg import read_leg_geometry
from hqpipe.rl.mirror import mirror_joints
from hqpipe.rl.observation import rotate_inverse


def test_lowest_foot_just_touches_the_ground(robot):
    geometry = read_leg_geometry(robot)
    config = RandomisationConfig(position=0.3, tilt=0.2)
    state = random_state(robot, geometry, config, 50, np.random.default_rng(0))
    feet = geometry.forward(state.joint_position.reshape(50, 4, 3))
    back = state.base_orientation * np.array([-1.0, -1.0, -1.0, 1.0])
    world = state.base_position[:, None] + rotate_inverse(np.repeat(back[:, None], 4, axis=1), feet)
    np.testing.assert_allclose(world[..., 2].min(axis=1), geometry.foot_radius, atol=1e-9)


def test_draws_stay_within_their_ranges(robot):
    config = RandomisationConfig(position=0.1, tilt=0.05, linear_velocity=0.3)
    state = random_state(robot, read_leg_geometry(robot), config, 200, np.random.default_rng(1))
    assert np.abs(state.joint_position - robot.nominal_position).max() <= 0.1
    assert np.abs(state.base_linear_velocity).max() <= 0.3
    np.testing.assert_allclose(np.linalg.norm(state.base_orientation, axis=1), 1.0)
    assert np.ptp(state.joint_position, axis=0).min() > 0.15


def test_robots_of_a_trial_stand_almost_still_and_are_no_mirror_images_of_themselves(robot):
    first, again = (trial_state(robot, read_leg_geometry(robot), 5) for _ in range(2))
    np.testing.assert_array_equal(first.joint_position, again.joint_position)
    assert np.abs(first.joint_position - robot.nominal_position).max() <= UNEVEN
    assert (
        np.abs(first.joint_position - mirror_joints(robot.feet).image(first.joint_position)).max(axis=1).min() > 0.001
    )
    assert not first.base_linear_velocity.any() and not first.base_angular_velocity.any()
