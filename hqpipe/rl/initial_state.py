"""States in which an episode or a trial starts: a robot near its nominal pose with its feet on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.rl.config import RandomisationConfig
from hqpipe.rl.leg import LegGeometry
from hqpipe.robots import RobotSpec

UNEVEN = 0.01  # rad, of the joints in which the robots of a trial differ; as much as an encoder may be off


@dataclass(frozen=True)
class InitialState:
    """Arguments of BatchedWorld.reset, one row per robot; SI, world frame, quaternions xyzw."""

    base_position: np.ndarray
    base_orientation: np.ndarray
    base_linear_velocity: np.ndarray
    base_angular_velocity: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray


def nominal_state(robot: RobotSpec, count: int) -> InitialState:
    """`count` robots that stand in the nominal pose at rest."""
    position = np.zeros((count, 3))
    position[:, 2] = robot.nominal_height
    orientation = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    joints = np.tile(robot.nominal_position, (count, 1))
    zeros = np.zeros((count, 3))
    return InitialState(position, orientation, zeros, zeros.copy(), joints, np.zeros_like(joints))


def trial_state(robot: RobotSpec, geometry: LegGeometry, count: int) -> InitialState:
    """`count` robots that stand at rest almost in the nominal pose, the same at every call.

    A robot that is its own mirror image to the last bit, with a policy that is symmetric and sees no clock, has no reason to
    lift one foot before the other: it stands still or hops.
    """
    uneven = RandomisationConfig(position=UNEVEN, tilt=0.0, linear_velocity=0.0, angular_velocity=0.0)
    return random_state(robot, geometry, uneven, count, np.random.default_rng(0))


def random_state(
    robot: RobotSpec,
    geometry: LegGeometry,
    config: RandomisationConfig,
    count: int,
    rng: np.random.Generator,
) -> InitialState:
    """`count` robots with random joint angles, tilt and velocity; the lowest foot just touches the ground."""
    state = nominal_state(robot, count)
    spread = rng.uniform(-config.position, config.position, size=state.joint_position.shape)
    joints = np.clip(state.joint_position + spread, robot.position_lower, robot.position_upper)
    roll, pitch = rng.uniform(-config.tilt, config.tilt, size=(2, count))
    # Small angles: roll then pitch as a quaternion, yaw zero because nothing depends on the heading.
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    orientation = np.stack((sr * cp, cr * sp, -sr * sp, cr * cp), axis=1)
    feet = geometry.forward(joints.reshape(count, len(robot.feet), 3))
    drop = -np.sin(pitch)[:, None] * feet[..., 0] + np.cos(pitch)[:, None] * (
        np.sin(roll)[:, None] * feet[..., 1] + np.cos(roll)[:, None] * feet[..., 2]
    )
    state.base_position[:, 2] = geometry.foot_radius - drop.min(axis=1)
    linear = rng.uniform(-config.linear_velocity, config.linear_velocity, size=(count, 3))
    linear[:, 2] = 0.0
    angular = rng.uniform(-config.angular_velocity, config.angular_velocity, size=(count, 3))
    return InitialState(state.base_position, orientation, linear, angular, joints, np.zeros_like(state.joint_velocity))
