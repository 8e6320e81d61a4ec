"""What one would write without hqpipe: one robot in plain pybullet as a Gymnasium environment, one process for each."""

from __future__ import annotations

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from hqpipe.robots import load_robot
from hqpipe.sim.engine import DECIMATION, FRICTION, robot_setup
from hqpipe.sim.pybullet_robot import load_robot_into, open_world, pybullet

ACTION_SCALE = 0.25  # rad, as in hqpipe.rl


class PlainEnv(gymnasium.Env):
    """Position targets round the nominal pose, the paper's actuator equation in numpy at 1 kHz, a trivial reward.

    Args:
        gains: k1 R² in N·m/rad, k2, k3 R² in N·m·s/rad.
        size: of the observation: joints, base and zeros for what a task would add.
    """

    def __init__(self, gains: tuple[float, float, float], size: int) -> None:
        self.robot, self.gains = load_robot("hydraulic_quadruped"), gains
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = Box(-1.0, 1.0, (len(self.robot.joints),), np.float32)
        self.client, _ = open_world()
        place = (0.0, 0.0, self.robot.nominal_height)
        self.loaded = load_robot_into(self.client, robot_setup(self.robot), self.robot.urdf, FRICTION, place)
        self.effort = np.zeros(len(self.robot.joints))

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        place, upright = (0.0, 0.0, self.robot.nominal_height), (0.0, 0.0, 0.0, 1.0)
        pybullet.resetBasePositionAndOrientation(self.loaded.body, place, upright, physicsClientId=self.client)
        pybullet.resetBaseVelocity(self.loaded.body, (0.0,) * 3, (0.0,) * 3, physicsClientId=self.client)
        for joint, angle in zip(self.loaded.joints, self.robot.nominal_position, strict=True):
            pybullet.resetJointState(self.loaded.body, joint, angle, physicsClientId=self.client)
        self.effort[:] = 0.0
        return self._observation(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        target = self.robot.nominal_position + ACTION_SCALE * np.asarray(action)
        k1, k2, k3 = self.gains
        for _ in range(DECIMATION):
            q, qd = self._joints()
            self.effort += k1 * (target - q) - k2 * self.effort - k3 * qd
            np.clip(self.effort, -self.robot.effort_limit, self.robot.effort_limit, out=self.effort)
            pybullet.setJointMotorControlArray(
                self.loaded.body,
                self.loaded.joints,
                pybullet.TORQUE_CONTROL,
                forces=self.effort,
                physicsClientId=self.client,
            )
            pybullet.stepSimulation(physicsClientId=self.client)
        observation = self._observation()
        return observation, float(observation[0]), False, False, {}

    def close(self) -> None:
        pybullet.disconnect(physicsClientId=self.client)

    def _joints(self) -> tuple[np.ndarray, np.ndarray]:
        rows = pybullet.getJointStates(self.loaded.body, self.loaded.joints, physicsClientId=self.client)
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    def _observation(self) -> np.ndarray:
        body, client = self.loaded.body, self.client
        linear, angular = pybullet.getBaseVelocity(body, physicsClientId=client)
        place, orientation = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
        pybullet.getContactPoints(body, physicsClientId=client)  # the feet's, which every reward asks for
        known = np.concatenate([linear, angular, place, orientation, *self._joints()])
        observation = np.zeros(self.observation_space.shape, dtype=np.float32)
        observation[: len(known)] = known
        return observation
