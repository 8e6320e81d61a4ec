"""Left for right: against the physics, the trot, and what a symmetric policy does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hqpipe.errors import ConfigError
from hqpipe.rl.gait import clock
from hqpipe.rl.mirror import check_alike, mirror_feet, mirror_joints, mirror_layout
from hqpipe.rl.networks import DeployedPolicy, LocomotionNetworks
from hqpipe.rl.observation import build_observation, build_state, rotate_inverse
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.sim.world import BatchedWorld

TURN = np.array([-1.0, 1.0, -1.0])  # of rates of turn
PLACE = np.array([1.0, -1.0, 1.0])  # of vectors


def test_images_of_images_are_as_they_were(spec):
    rng = np.random.default_rng(0)
    for layout in (spec.observation, spec.state):
        mirror = mirror_layout(layout, spec.feet)
        values = rng.normal(size=(3, layout.size))
        np.testing.assert_allclose(mirror.image(mirror.image(values)), values)
        assert not np.allclose(mirror.image(values), values)
        np.testing.assert_allclose(mirror.image(layout.offset), layout.offset, err_msg="signs pass normalisation")


def test_a_robot_in_the_mirror_moves_like_its_image(spec, robot, actuator):
    """Two robots in the air, one the image of the other, with targets that are images: sensors show images, too."""
    rng = np.random.default_rng(1)
    joints = mirror_joints(spec.feet)
    orientation = np.array([0.1, -0.15, 0.2, 1.0])
    orientation /= np.linalg.norm(orientation)
    position = robot.nominal_position + rng.uniform(-0.1, 0.1, 12)
    velocity, turning = rng.uniform(-0.5, 0.5, (2, 3))
    speed = rng.uniform(-0.5, 0.5, 12)
    world = BatchedWorld(robot, actuator, 2, engine="mujoco", workers=1)
    try:
        world.reset(
            np.arange(2),
            base_position=np.array([[0.0, 0.0, 2.0]] * 2),
            base_orientation=np.stack([orientation, orientation * [-1.0, 1.0, -1.0, 1.0]]),
            base_linear_velocity=np.stack([velocity, velocity * PLACE]),
            base_angular_velocity=np.stack([turning, turning * TURN]),
            joint_position=np.stack([position, joints.image(position)]),
            joint_velocity=np.stack([speed, joints.image(speed)]),
        )
        targets = robot.nominal_position + rng.uniform(-0.3, 0.3, 12)
        for _ in range(3):
            world.step(np.stack([targets, joints.image(targets)]))
        s = world.state
        height = s.base_position[:, 2]
        turn = rotate_inverse(s.base_orientation, s.base_angular_velocity)
        down = rotate_inverse(s.base_orientation, np.tile([0.0, 0.0, -1.0], (2, 1)))
        moved = rotate_inverse(s.base_orientation, s.base_linear_velocity)
        command = np.array([[0.5, 0.2, 0.3], [0.5, -0.2, -0.3]])
        phase = clock(np.array([0.2, 0.7]))
        seen = build_observation(turn, s.joint_position, s.joint_velocity, s.joint_position, command, phase)
    finally:
        world.close()
    contact = np.array([[1, 0, 0, 0], [0, 1, 0, 0]])
    state = build_state(moved, down, height, contact, 0.1 * contact)
    for layout, (own, image) in ((spec.observation, seen), (spec.state, state)):
        np.testing.assert_allclose(mirror_layout(layout, spec.feet).image(own), image, atol=2e-4)
    assert np.abs(seen[0] - seen[1]).max() > 0.1


def test_the_mirrored_trot_is_half_a_cycle_ahead(spec):
    even = replace(spec, position_stiffness=np.full(12, 6000.0)).target_rule().trot
    phase = np.linspace(0.0, 1.0, 20, endpoint=False)
    command = np.tile([0.8, 0.2, 0.4], (20, 1))
    own = even.joint_targets(clock(phase), command)
    other = even.joint_targets(clock(phase + 0.5), command * [1.0, -1.0, -1.0])
    np.testing.assert_allclose(mirror_joints(spec.feet).image(own), other, atol=1e-6)


@pytest.mark.parametrize("leg_odometry", [True, False])
@pytest.mark.parametrize("symmetric", [True, False])
def test_only_a_symmetric_policy_does_on_the_left_what_it_does_on_the_right(spec, symmetric, leg_odometry):
    stiffness = np.full(12, 6000.0)
    spec = replace(spec, symmetric=symmetric, leg_odometry=leg_odometry, position_stiffness=stiffness)
    torch.manual_seed(0)
    policy = DeployedPolicy(spec, LocomotionNetworks(spec)).eval()
    rng = np.random.default_rng(2)
    seen = spec.observation.offset + rng.normal(size=(7, spec.observation.size)) / spec.observation.scale
    image = mirror_layout(spec.observation, spec.feet).image(seen)
    with torch.no_grad():
        own, believed = (part.numpy() for part in policy(torch.as_tensor(seen, dtype=torch.float32)))
        other, thought = (part.numpy() for part in policy(torch.as_tensor(image, dtype=torch.float32)))
    same = np.allclose(mirror_joints(spec.feet).image(own), other, atol=1e-4)
    alike = np.allclose(mirror_layout(spec.state, spec.feet).image(believed), thought, atol=1e-3)
    assert (same, alike) == (symmetric, symmetric)


def test_a_robot_with_two_different_sides_is_refused(spec, robot, actuator, small):
    check_alike("mine", spec.feet, spec.geometry, spec.nominal)
    hip = spec.geometry.hip.copy()
    hip[0, 1] += 0.01
    with pytest.raises(ConfigError, match=r"hips of mine differ between left and right.*set policy.symmetric to false"):
        check_alike("mine", spec.feet, replace(spec.geometry, hip=hip), spec.nominal)
    with pytest.raises(ConfigError, match="nominal joint angles"):
        check_alike("mine", spec.feet, spec.geometry, spec.nominal + np.eye(12)[0])
    with pytest.raises(
        ConfigError, match=r"feet of mine are FL, FR, expected LF, RF, LH, RH.*name them so in robot.yaml"
    ):
        check_alike("mine", ["FL", "FR"], spec.geometry, spec.nominal)
    free = replace(small, policy=replace(small.policy, symmetric=False))
    assert spec.symmetric and not PolicySpec.build(robot, actuator, free).symmetric


def test_legs_change_sides(spec):
    assert [spec.feet[i] for i in mirror_feet(spec.feet).order] == ["RF", "LF", "RH", "LH"]
