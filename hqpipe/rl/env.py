"""The task as a vectorised environment of Stable-Baselines3 and as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import VecEnv

from hqpipe.actuators.base import ActuatorModel
from hqpipe.rl.config import PPOConfig, TrainConfig, from_mapping
from hqpipe.rl.policy_spec import PolicySpec
from hqpipe.rl.task import LocomotionTask, Outcome
from hqpipe.rl.worlds import training_world, unmodelled_actuator
from hqpipe.robots import load_robot

# Actions are offsets in units of action_scale; the bound only keeps a diverging policy finite.
ACTION_BOUND = 10.0


def observation_space(task: LocomotionTask) -> Box:
    """o_t and x_t side by side, physical units."""
    return Box(-np.inf, np.inf, (task.observation_size,), np.float32)


def action_space(task: LocomotionTask) -> Box:
    return Box(-ACTION_BOUND, ACTION_BOUND, (len(task.robot.joints),), np.float32)


class LocomotionVecEnv(VecEnv):
    """All robots of a task as one SB3 environment.

    An episode that ends by its time limit carries ``TimeLimit.truncated`` and the observation before the reset, from
    which SB3 bootstraps the value.

    Attributes:
        last: outcome of the last period, for the metrics.
    """

    def __init__(self, task: LocomotionTask) -> None:
        self.task = task
        self.last: Outcome | None = None
        self.render_mode = None
        self._actions = np.zeros((task.count, len(task.robot.joints)))
        self._returns = np.zeros(task.count)
        self._lengths = np.zeros(task.count, dtype=np.int64)
        super().__init__(task.count, observation_space(task), action_space(task))

    def reset(self) -> np.ndarray:
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return self.task.reset()

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        outcome = self.last = self.task.step(self._actions)
        self._returns += outcome.reward
        self._lengths += 1
        done = outcome.fell | outcome.timed_out
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": outcome.final_observation[i],
                "TimeLimit.truncated": bool(outcome.timed_out[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": 0.0},
            }
        self._returns[done] = 0.0
        self._lengths[done] = 0
        return outcome.observation, outcome.reward, done, infos

    def close(self) -> None:
        self.task.world.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError("the robots share one task: set its attributes directly")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError("the robots share one task: call its methods directly")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * len(self._rows(indices))

    def _rows(self, indices: None | int | Sequence[int]) -> Sequence[int]:
        if indices is None:
            return range(self.num_envs)
        return [indices] if isinstance(indices, int) else indices


class LocomotionEnv(gymnasium.Env):
    """One robot, for tools that speak Gymnasium; registered as ``hqpipe/HydraulicQuadruped-v0``.

    Args:
        robot: name or folder. config: fields of TrainConfig as a nested mapping.
        actuator: an instance of an actuator model; default stiff_pd with the robot's gains.
        seed: of the world's randomisation.
    """

    metadata = {"render_modes": []}

    def __init__(
        self,
        robot: str = "hydraulic_quadruped",
        config: dict[str, Any] | None = None,
        actuator: ActuatorModel | None = None,
        seed: int = 0,
    ) -> None:
        spec = load_robot(robot)
        model = unmodelled_actuator(spec, "position") if actuator is None else actuator
        settings = from_mapping(TrainConfig(num_envs=1, ppo=PPOConfig(batch_size=PPOConfig.n_steps)), config or {})
        world = training_world(spec, model, settings, num_envs=1, workers=1, seed=seed)
        policy = PolicySpec.build(spec, model, settings)
        self.task = LocomotionTask(spec, policy, world, settings, training=True, seed=seed)
        self.observation_space = observation_space(self.task)
        self.action_space = action_space(self.task)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """`seed` restarts the random numbers of commands, noise and initial states."""
        super().reset(seed=seed)
        if seed is not None:
            self.task.rng = np.random.default_rng(seed)
        return self.task.reset()[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        outcome = self.task.step(np.asarray(action)[None])
        fell, timed_out = bool(outcome.fell[0]), bool(outcome.timed_out[0])
        return (
            outcome.final_observation[0],
            float(outcome.reward[0]),
            fell,
            timed_out,
            {"rewards": outcome.terms},
        )

    def close(self) -> None:
        self.task.world.close()
