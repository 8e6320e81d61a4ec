"""A robot, its stiff actuator, and worlds that close themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np
import pytest

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.robots import RobotSpec, load_robot
from hqpipe.sim import ENGINES
from hqpipe.sim.state import WorldState
from hqpipe.sim.world import BatchedWorld

THIGH = SHANK = 0.45  # m, robot.urdf


@pytest.fixture(scope="session")
def robot() -> RobotSpec:
    return load_robot("hydraulic_quadruped")


@pytest.fixture(scope="session")
def stiff(robot: RobotSpec) -> ActuatorModel:
    return StiffPD.build(robot.joints, kp=robot.stiff_pd.kp, kd=robot.stiff_pd.kd, effort_limit=robot.effort_limit)


@pytest.fixture(params=list(ENGINES))
def engine(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def make_world(robot: RobotSpec, stiff: ActuatorModel) -> Iterator[Callable[..., BatchedWorld]]:
    """BatchedWorld with the stiff actuator and one worker unless told otherwise."""
    worlds = []

    def make(num_envs: int = 1, actuator: ActuatorModel = stiff, **options) -> BatchedWorld:
        options.setdefault("workers", 1)
        worlds.append(BatchedWorld(robot, actuator, num_envs, **options))
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def nominal(robot: RobotSpec) -> Callable[..., dict[str, np.ndarray]]:
    """Arguments of BatchedWorld.reset for n robots at rest in the nominal pose, with changes."""

    def build(n: int, **changes) -> dict[str, np.ndarray]:
        values = {
            "base_position": [0.0, 0.0, robot.nominal_height],
            "base_orientation": [0.0, 0.0, 0.0, 1.0],
            "base_linear_velocity": [0.0, 0.0, 0.0],
            "base_angular_velocity": [0.0, 0.0, 0.0],
            "joint_position": robot.nominal_position,
            "joint_velocity": np.zeros(len(robot.joints)),
        }
        return {key: np.tile(changes.get(key, value), (n, 1)) for key, value in values.items()}

    return build


@pytest.fixture(scope="session")
def trot(robot: RobotSpec) -> Callable[[float], np.ndarray]:
    """Joint targets (J,) of an open-loop trot at time t: duty 0.6, feet 12 cm high, 0.6 m/s."""

    def inverse(x: float, z: float) -> tuple[float, float]:
        knee = -np.arccos((x * x + z * z - THIGH**2 - SHANK**2) / (2 * THIGH * SHANK))
        return np.arctan2(-x, -z) - np.arctan2(SHANK * np.sin(knee), THIGH + SHANK * np.cos(knee)), knee

    def targets(t: float, speed: float = 0.6, frequency: float = 1.7, duty: float = 0.6) -> np.ndarray:
        pitch, knee = robot.nominal_position[1:3]
        foot = -np.array([THIGH * np.sin(pitch) + SHANK * np.sin(pitch + knee), 0.0])
        foot[1] = -THIGH * np.cos(pitch) - SHANK * np.cos(pitch + knee)
        ramp, stride = min(t / 0.5, 1.0), speed * duty / frequency
        result = np.zeros(12)
        for leg, offset in enumerate((0.0, 0.5, 0.5, 0.0)):
            phase = (frequency * (t + 0.03) + offset) % 1.0
            along, lift = 0.5 - phase / duty, 0.0
            if phase > duty:
                u = (phase - duty) / (1.0 - duty)
                along = u * u * (3 - 2 * u) - 0.5 - (1 - duty) / duty * u * (1 - u) * (1 - 2 * u)
                lift = 0.12 * np.sin(np.pi * u) ** 2
            result[3 * leg + 1 : 3 * leg + 3] = inverse(foot[0] + ramp * stride * along, foot[1] + ramp * lift)
        return result

    return targets


@pytest.fixture(scope="session")
def snapshot() -> Callable[..., np.ndarray]:
    """Every number of the state of some environments, (n, …) flattened to (n, k)."""

    def take(state: WorldState, rows=slice(None)) -> np.ndarray:
        parts = [np.asarray(getattr(state, f.name)[rows], dtype=float) for f in fields(state)]
        return np.concatenate([part.reshape(len(part), -1) for part in parts], axis=1)

    return take
