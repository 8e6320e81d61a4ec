"""Leg odometry: against finite differences of the leg, of the simulator, and of a rolling foot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hqpipe.rl.evaluate import zero_actor
from hqpipe.rl.leg import read_leg_geometry
from hqpipe.rl.leg_odometry import trunk_velocities
from hqpipe.rl.limits import FASTEST
from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.observation import rotate_inverse
from hqpipe.rl.task import LocomotionTask
from hqpipe.sim.world import BatchedWorld


@pytest.fixture(scope="module")
def leg(robot):
    return read_leg_geometry(robot)


def motions(robot, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turning rates, joint angles and joint rates."""
    rng = np.random.default_rng(3)
    joints = rng.uniform(robot.position_lower, robot.position_upper, size=(count, 12)).reshape(count, 4, 3)
    return rng.normal(size=(count, 3)), joints, rng.normal(size=(count, 4, 3))


def test_foot_velocity_is_the_slope_of_the_foot_position(robot, leg):
    _, joints, rates = motions(robot, 50)
    step = 1e-6
    slope = (leg.forward(joints + step * rates) - leg.forward(joints - step * rates)) / (2.0 * step)
    np.testing.assert_allclose(leg.velocity(joints, rates), slope, atol=1e-8)


def test_a_standing_foot_rests_at_its_lowest_point(robot, leg):
    """The point of the shank that touches the ground, carried along by trunk and joints for a moment."""
    turning, joints, rates = motions(robot, 50)
    step = 1e-6

    def contact(sign: float) -> np.ndarray:
        """(N, L, 3) in the base frame as it was: what was the lowest point of the foot, `sign` steps later."""
        moved = joints + sign * step * rates
        before, after = (
            Rotation.from_euler("XY", np.stack((q[..., 0], q[..., 1] + q[..., 2]), -1).reshape(-1, 2))
            for q in (joints, moved)
        )
        lowest = (after * before.inv()).apply([0.0, 0.0, -leg.foot_radius]).reshape(moved.shape)
        trunk = Rotation.from_rotvec(np.repeat(sign * step * turning, 4, axis=0))
        return trunk.apply((leg.forward(moved) + lowest).reshape(-1, 3)).reshape(moved.shape)

    slope = (contact(1.0) - contact(-1.0)) / (2.0 * step)
    np.testing.assert_allclose(trunk_velocities(leg, turning, joints, rates), -slope, atol=1e-8)


def test_the_simulator_moves_its_feet_so(robot, actuator, leg):
    """In flight, with turning trunk and moving joints: each foot centre moves against the trunk as the joints say."""
    rng = np.random.default_rng(4)
    world = BatchedWorld(robot, actuator, 1, engine="mujoco", workers=1, decimation=1)
    try:
        world.reset(
            np.arange(1),
            base_position=np.array([[0.0, 0.0, 3.0]]),
            base_orientation=np.array([[0.0, 0.0, 0.0, 1.0]]),
            base_linear_velocity=rng.uniform(-0.5, 0.5, (1, 3)),
            base_angular_velocity=rng.uniform(-0.5, 0.5, (1, 3)),
            joint_position=robot.nominal_position[None] + rng.uniform(-0.1, 0.1, (1, 12)),
            joint_velocity=rng.uniform(-1.0, 1.0, (1, 12)),
        )
        s, places = world.state, []
        for tick in range(22):
            world.step(s.joint_position.copy())
            places.append((s.foot_position - s.base_position[:, None]).copy())
            if tick == 20:
                joints, rates = s.joint_position.reshape(1, 4, 3).copy(), s.joint_velocity.reshape(1, 4, 3).copy()
                turning, orientation = s.base_angular_velocity.copy(), s.base_orientation.copy()
    finally:
        world.close()
    slope = (places[21] - places[19]) / 2e-3  # of the foot against the trunk's origin, world axes
    seen = rotate_inverse(orientation[:, None], slope)
    centre = replace(leg, foot_radius=0.0)
    told = -trunk_velocities(centre, turning, joints, rates)
    np.testing.assert_allclose(told, seen, atol=0.01)
    assert np.abs(seen).max() > 0.2


def test_standing_legs_tell_the_speed_of_a_walking_robot(robot, actuator, small, spec, leg):
    world = BatchedWorld(robot, actuator, 1, engine="mujoco", workers=1)
    task = LocomotionTask(robot, spec, world, small, training=False, seed=0)
    act, told, true = zero_actor(12), [], []
    try:
        observation = task.reset()
        task.set_commands(np.array([[0.8, 0.0, 0.0]]))
        for period in range(300):
            observation = task.step(act(observation)).observation
            s = world.state
            joints, rates = s.joint_position.reshape(1, 4, 3), s.joint_velocity.reshape(1, 4, 3)
            legs = trunk_velocities(leg, s.base_angular_velocity, joints, rates)
            if period >= 100 and s.foot_contact.any():
                told.append(legs[s.foot_contact].mean(axis=0)[:2])
                true.append(task.base_velocity()[0, :2])
    finally:
        world.close()
    assert np.mean(true, axis=0)[0] > 0.6
    np.testing.assert_allclose(np.mean(told, axis=0), np.mean(true, axis=0), atol=0.03)


def test_torch_agrees_with_numpy(robot, leg):
    given = [part.astype(np.float32) for part in motions(robot, 20)]
    told = trunk_velocities(leg, *map(torch.as_tensor, given), torch).numpy()
    np.testing.assert_allclose(told, trunk_velocities(leg, *given), atol=1e-5)


def test_the_estimated_velocity_follows_the_legs(spec):
    """With a network that says nothing, all legs count alike and nothing is corrected."""
    spec = replace(spec, leg_odometry=True, symmetric=False)
    networks = LocomotionNetworks(spec, output_gain=0.0)
    rng = np.random.default_rng(5)
    seen = (spec.observation.offset + rng.normal(size=(6, spec.observation.size)) / spec.observation.scale).astype(
        np.float32
    )
    believed = networks.normalise_state.restore(networks.estimate(torch.as_tensor(seen))).numpy()
    layout = spec.observation
    joints, rates = (seen[:, layout.part(name)].reshape(6, 4, 3) for name in ("joint_position", "joint_velocity"))
    legs = trunk_velocities(spec.geometry, seen[:, layout.part("base_angular_velocity")], joints, rates)
    velocity = spec.state.part("base_linear_velocity")
    np.testing.assert_allclose(believed[:, velocity], legs.mean(axis=1), atol=1e-4)
    rest = np.delete(believed, np.r_[velocity], axis=1)
    np.testing.assert_allclose(rest, np.tile(spec.state.offset[3:], (6, 1)), atol=1e-5)


def test_a_leg_that_is_torn_about_is_believed_within_bounds(spec):
    spec = replace(spec, leg_odometry=True, symmetric=False)
    networks = LocomotionNetworks(spec, output_gain=0.0)
    seen = torch.as_tensor(np.tile(spec.observation.offset, (2, 1)))
    seen[:, spec.observation.part("joint_velocity")] = torch.tensor([[1e6], [-1e6]])
    believed = networks.normalise_state.restore(networks.estimate(seen))
    velocity = believed[:, spec.state.part("base_linear_velocity")]
    assert velocity.abs().max() == pytest.approx(FASTEST, rel=1e-5)
