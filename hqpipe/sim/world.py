"""A batch of independent robots on flat ground: physics and actuator model at 1 kHz, one call per 10 ms."""

from __future__ import annotations

from typing import Self

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.errors import UsageError
from hqpipe.robots import RobotSpec
from hqpipe.sim import ENGINES
from hqpipe.sim.engine import DECIMATION, PHYSICS_DT, EngineSetup, robot_setup
from hqpipe.sim.randomisation import KinematicsRandomisation, robot_variants
from hqpipe.sim.state import ArraySizes, WorldState, read_only
from hqpipe.sim.teams import ProcessTeam, Team, ThreadTeam, split


class BatchedWorld:
    """N environments, each one robot alone on an unbounded floor at z = 0.

    Within a physics step the actuator model turns the target and the present joint state into torque, then the engine
    moves the robot (semi-implicit Euler in both engines). The result depends on neither the number of workers nor what
    the other environments do, and a reset in place equals a new world.

    Args:
        robot: gives the URDF and the order of joints and feet.
        actuator: model with a row for every joint of the robot, matched by name.
        num_envs: N.
        engine: name in ENGINES.
        workers: processes (pybullet) or threads (mujoco), at most one per block of environments.
        seed: of the randomisation.
        randomisation: family of robots; None for N exact ones.
        decimation: physics steps of 1 ms in one policy step.

    Raises:
        UsageError: unknown engine, a joint without actuator, an actuator for another rate, a number below 1.
    """

    def __init__(
        self,
        robot: RobotSpec,
        actuator: ActuatorModel,
        num_envs: int,
        *,
        engine: str = "pybullet",
        workers: int = 2,
        seed: int = 0,
        randomisation: KinematicsRandomisation | None = None,
        decimation: int = DECIMATION,
    ) -> None:
        for name, value in (("num_envs", num_envs), ("workers", workers), ("decimation", decimation)):
            if value < 1:
                raise UsageError(f"BatchedWorld: {name} is {value}, expected at least 1")
        actuator.check_dt(PHYSICS_DT)
        self.robot, self.num_envs = robot, num_envs
        self.actuator = actuator.for_joints(robot.joints)
        self._limit_column = list(actuator.FIELDS).index("effort_limit")
        variants = robot_variants(robot, randomisation, seed)
        setup = robot_setup(robot, kind=actuator.KIND, decimation=decimation, variants=variants)
        sizes = ArraySizes(
            envs=num_envs,
            joints=len(robot.joints),
            parameters=len(actuator.FIELDS),
            feet=len(robot.feet),
            memory=actuator.memory_columns,
            weights=len(self.actuator.weights),
        )
        self._team = _make_team(engine, setup, sizes, workers)
        self._arrays = self._team.arrays
        self._arrays.weights[:] = self.actuator.weights
        self._open = True
        self.state: WorldState = read_only(self._arrays.state)
        everyone = np.arange(num_envs)
        self.set_actuator_parameters(
            everyone, np.broadcast_to(self.actuator.parameters, (num_envs, *self.actuator.parameters.shape))
        )
        self._reset_to_nominal(everyone)

    def set_actuator_parameters(self, indices: np.ndarray, parameters: np.ndarray) -> None:
        """Give some robots actuators of their own, e.g. randomised ones, without memory of what was before.

        Args:
            indices: (n,) environments.
            parameters: (n, J, P) with the columns of `world.actuator.FIELDS`; the robot's own effort limit still holds.

        Raises:
            UsageError: wrong shape.
        """
        indices = self._indices(indices)
        table = self._expect("parameters", parameters, (len(indices), *self.actuator.parameters.shape)).copy()
        limit = np.minimum(table[..., self._limit_column], self.robot.effort_limit)
        table[..., self._limit_column] = np.inf
        self._arrays.parameters[indices] = table
        self._arrays.effort_limit[indices] = limit
        self._arrays.state.actuator_memory[indices] = 0.0

    def step(self, targets: np.ndarray) -> WorldState:
        """Hold joint position targets (N, J), rad, for one policy step; returns `state`."""
        self._check_open()
        self._arrays.targets[:] = self._expect("targets", targets, self._arrays.targets.shape)
        self._team.step()
        return self.state

    def reset(
        self,
        indices: np.ndarray,
        base_position: np.ndarray,
        base_orientation: np.ndarray,
        base_linear_velocity: np.ndarray,
        base_angular_velocity: np.ndarray,
        joint_position: np.ndarray,
        joint_velocity: np.ndarray,
        joint_effort: np.ndarray | None = None,
    ) -> WorldState:
        """Put n robots into a state, in units and frames of WorldState; the other robots do not notice.

        Args:
            indices: (n,) environments; the other arrays have n rows.
            joint_effort: torque at which the actuator model starts, N·m; zero if not given. Its memory starts empty.

        Returns:
            `state`; contacts and foot forces of these robots read zero until the next step.

        Raises:
            UsageError: wrong shape or index.
        """
        self._check_open()
        indices, state = self._indices(indices), self._arrays.state
        values = {
            "base_position": base_position,
            "base_orientation": base_orientation,
            "base_linear_velocity": base_linear_velocity,
            "base_angular_velocity": base_angular_velocity,
            "joint_position": joint_position,
            "joint_velocity": joint_velocity,
            "joint_effort": np.zeros_like(joint_velocity) if joint_effort is None else joint_effort,
        }
        checked = {
            name: self._expect(name, value, (len(indices), *getattr(state, name).shape[1:]))
            for name, value in values.items()
        }
        length = np.linalg.norm(checked["base_orientation"], axis=1, keepdims=True)
        if not (np.abs(length - 1.0) < 1e-3).all():
            raise UsageError("reset: base_orientation must be unit quaternions x, y, z, w")
        checked["base_orientation"] = checked["base_orientation"] / length
        for name, value in checked.items():
            getattr(state, name)[indices] = value
        state.actuator_memory[indices] = 0.0
        state.effort_mean_square[indices] = 0.0
        state.effort_clipped[indices] = 0.0
        self._arrays.reset_flag[indices] = True
        self._team.reset()
        return self.state

    def apply_push(self, indices: np.ndarray, impulse: np.ndarray) -> None:
        """Push n robots at the centre of mass of their base.

        Args:
            impulse: (n, 3) N·s in the world frame, spread evenly over the next policy step.
        """
        indices = self._indices(indices)
        np.add.at(self._arrays.impulse, indices, self._expect("impulse", impulse, (len(indices), 3)))

    def close(self) -> None:
        """Free the engines; `state` stays readable."""
        self._open = False
        self._team.close()

    def _check_open(self) -> None:
        if not self._open:
            raise UsageError("BatchedWorld: it is closed; make a new one")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _reset_to_nominal(self, indices: np.ndarray) -> None:
        rows, still = len(indices), np.zeros((len(indices), 3))
        self.reset(
            indices,
            np.tile([0.0, 0.0, self.robot.nominal_height], (rows, 1)),
            np.tile([0.0, 0.0, 0.0, 1.0], (rows, 1)),
            still,
            still,
            np.tile(self.robot.nominal_position, (rows, 1)),
            np.zeros((rows, len(self.robot.joints))),
        )

    def _indices(self, indices: np.ndarray) -> np.ndarray:
        array = np.atleast_1d(np.asarray(indices))
        if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
            raise UsageError(f"indices: expected a list of environment numbers, got {indices!r}")
        if array.size and not (0 <= array.min() and array.max() < self.num_envs):
            raise UsageError(f"indices: expected 0 … {self.num_envs - 1}, got {array.min()} … {array.max()}")
        return array.astype(np.intp)

    @staticmethod
    def _expect(name: str, value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != shape:
            raise UsageError(f"{name}: expected shape {shape}, got {array.shape}")
        return array


def _make_team(engine: str, setup: EngineSetup, sizes: ArraySizes, workers: int) -> Team:
    kind = ENGINES[engine]
    ranges = split(sizes.envs, kind.BLOCK, workers)
    if kind.PARALLEL == "processes" and len(ranges) > 1:
        return ProcessTeam(engine, setup, sizes, ranges)
    return ThreadTeam(kind, setup, sizes, ranges)
