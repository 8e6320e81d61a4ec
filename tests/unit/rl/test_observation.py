from __future__ import annotations

import numpy as np
import pytest

from hqpipe.rl.config import NoiseConfig
from hqpipe.rl.observation import (
    build_observation,
    build_state,
    noise_half_width,
    observation_layout,
    rotate_inverse,
    state_layout,
)


def test_paper_observation_has_42_elements_in_its_order(robot):
    layout = observation_layout(robot, "none")
    assert layout.size == 42
    assert [t.name for t in layout.terms] == [
        "base_angular_velocity",
        "joint_position",
        "joint_velocity",
        "previous_target",
        "velocity_command",
    ]


def test_the_command_is_scaled_as_it_is_asked_for(robot):
    plain, larger = (observation_layout(robot, "none", scale).scale for scale in (1.0, 4.0))
    np.testing.assert_array_equal(plain, observation_layout(robot, "none").scale)
    np.testing.assert_array_equal(larger / plain, [1.0] * 39 + [4.0] * 3)


@pytest.mark.parametrize("prior", ["clock", "trot_residual"])
def test_clock_comes_last(robot, prior):
    layout = observation_layout(robot, prior)
    assert layout.part("clock") == slice(42, 44)


def test_every_value_lands_in_its_part(robot):
    layout = observation_layout(robot, "clock")
    joints = np.arange(12.0)
    seen = build_observation(
        np.array([1.0, 2.0, 3.0]),
        10 + joints,
        30 + joints,
        50 + joints,
        np.array([7.0, 8.0, 9.0]),
        np.array([0.6, 0.8]),
    )
    assert seen.dtype == np.float32
    np.testing.assert_array_equal(seen[layout.part("base_angular_velocity")], [1, 2, 3])
    np.testing.assert_array_equal(seen[layout.part("joint_position")], 10 + joints)
    np.testing.assert_array_equal(seen[layout.part("joint_velocity")], 30 + joints)
    np.testing.assert_array_equal(seen[layout.part("previous_target")], 50 + joints)
    np.testing.assert_array_equal(seen[layout.part("velocity_command")], [7, 8, 9])
    np.testing.assert_allclose(seen[layout.part("clock")], [0.6, 0.8], rtol=1e-6)


def test_batch_and_single_build_the_same_numbers():
    rng = np.random.default_rng(0)
    parts = [rng.normal(size=(5, n)) for n in (3, 12, 12, 12, 3, 2)]
    batch = build_observation(*parts)
    for i in range(5):
        np.testing.assert_array_equal(build_observation(*(p[i] for p in parts)), batch[i])


def test_state_of_a_standing_robot_is_normalised_to_zero_but_for_the_contacts(robot):
    layout = state_layout(robot)
    state = build_state(
        np.zeros((1, 3)),
        np.array([[0.0, 0.0, -1.0]]),
        np.array([robot.nominal_height]),
        np.ones((1, 4), dtype=bool),
        np.zeros((1, 4)),
    )
    normal = (state[0] - layout.offset) * layout.scale
    contact = layout.part("foot_contact")
    np.testing.assert_allclose(normal[contact], 1.0)
    normal[contact] = 0.0
    np.testing.assert_allclose(normal, 0.0, atol=1e-5)


def test_noise_spares_targets_command_and_clock(robot):
    layout = observation_layout(robot, "clock")
    width = noise_half_width(layout, NoiseConfig(gyro=0.1, position=0.2, velocity=0.3))
    assert set(width[:3]) == {np.float32(0.1)}
    assert (width[27:] == 0.0).all()


def test_rotate_inverse_turns_gravity_into_a_pitched_frame():
    pitch = 0.3  # nose down for a positive turn about y
    orientation = np.array([[0.0, np.sin(pitch / 2), 0.0, np.cos(pitch / 2)]])
    gravity = rotate_inverse(orientation, np.array([[0.0, 0.0, -1.0]]))
    np.testing.assert_allclose(gravity, [[np.sin(pitch), 0.0, -np.cos(pitch)]], atol=1e-12)
