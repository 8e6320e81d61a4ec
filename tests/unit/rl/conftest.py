from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.actuators.base import ActuatorModel
from hqpipe.rl.config import TrainConfig, from_mapping
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.rl.worlds import unmodelled_actuator
from hqpipe.robots import RobotSpec, load_robot

SMALL = {
    "total_steps": 240,
    "num_envs": 4,
    "checkpoint_interval": 2,
    "engine": "mujoco",
    "episode_s": 0.3,
    "policy": {"hidden": [16, 16]},
    "ppo": {"n_steps": 10, "batch_size": 20, "n_epochs": 2, "critic_warmup": 1},
    "evaluation": {"num_envs": 2, "seconds": 0.2, "interval": 3, "commands": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
}


@pytest.fixture(scope="session")
def robot() -> RobotSpec:
    return load_robot("hydraulic_quadruped")


@pytest.fixture(scope="session")
def actuator(robot: RobotSpec) -> ActuatorModel:
    return unmodelled_actuator(robot, "position")


@pytest.fixture(scope="session")
def small() -> TrainConfig:
    """A training of six iterations that takes about a second."""
    return from_mapping(TrainConfig(num_envs=400), SMALL)


@pytest.fixture(scope="session")
def spec(robot: RobotSpec, actuator: ActuatorModel, small: TrainConfig) -> PolicySpec:
    return PolicySpec.build(robot, actuator, small)


class StillWorld:
    """A world that holds the state it is given; targets and pushes are written down."""

    def __init__(self, robot: RobotSpec, num_envs: int) -> None:
        n, joints, feet = num_envs, len(robot.joints), len(robot.feet)
        self.num_envs = n
        self.targets, self.pushes, self.resets = [], [], []
        self.state = SimpleNamespace(
            base_position=np.zeros((n, 3)),
            base_orientation=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
            base_linear_velocity=np.zeros((n, 3)),
            base_angular_velocity=np.zeros((n, 3)),
            joint_position=np.zeros((n, joints)),
            joint_velocity=np.zeros((n, joints)),
            joint_effort=np.zeros((n, joints)),
            effort_mean_square=np.zeros((n, joints)),
            effort_clipped=np.zeros((n, joints)),
            foot_position=np.zeros((n, feet, 3)),
            foot_velocity=np.zeros((n, feet, 3)),
            foot_force=np.zeros((n, feet, 3)),
            foot_contact=np.ones((n, feet), dtype=bool),
            illegal_contact=np.zeros(n, dtype=bool),
        )

    def step(self, targets: np.ndarray) -> SimpleNamespace:
        self.targets.append(targets.copy())
        return self.state

    def reset(self, indices, position, orientation, linear, angular, joints, joint_velocity) -> SimpleNamespace:
        self.resets.append(list(indices))
        s = self.state
        s.base_position[indices], s.base_orientation[indices] = position, orientation
        s.base_linear_velocity[indices], s.base_angular_velocity[indices] = linear, angular
        s.joint_position[indices], s.joint_velocity[indices] = joints, joint_velocity
        s.illegal_contact[indices] = False
        return s

    def apply_push(self, indices, impulse) -> None:
        self.pushes.append((indices.copy(), impulse.copy()))

    def close(self) -> None:
        pass


@pytest.fixture
def still_world(robot: RobotSpec) -> StillWorld:
    return StillWorld(robot, 3)
