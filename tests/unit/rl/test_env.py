from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from hqpipe.rl.env import LocomotionVecEnv
from hqpipe.rl.registration import ENVIRONMENT_ID, register_environments
from hqpipe.rl.task import LocomotionTask

CONFIG = {"engine": "mujoco", "episode_s": 0.5}


@pytest.fixture(scope="module")
def environment():
    register_environments()
    env = gymnasium.make(ENVIRONMENT_ID, config=CONFIG, disable_env_checker=True)
    yield env
    env.close()


def test_gymnasium_accepts_the_environment(environment):
    check_env(environment.unwrapped, skip_render_check=True)


def test_episode_is_truncated_at_the_time_limit(environment):
    environment.reset(seed=1)
    ends = []
    for _ in range(50):
        _, _, terminated, truncated, info = environment.step(np.zeros(12, dtype=np.float32))
        ends.append((terminated, truncated))
    assert ends[-1] == (False, True) and not any(t for _, t in ends[:-1])
    assert "tracking" in info["rewards"]


def test_vectorised_environment_reports_truncation_for_bootstrapping(robot, spec, still_world, small):
    task = LocomotionTask(robot, spec, still_world, small, training=True, seed=0)
    env = LocomotionVecEnv(task)
    env.reset()
    task.steps[0] = 28
    env.step(np.zeros((3, 12)))
    observation, reward, done, infos = env.step(np.zeros((3, 12)))
    assert done.tolist() == [True, False, False]
    assert infos[0]["TimeLimit.truncated"] is True
    assert infos[0]["terminal_observation"].shape == observation[0].shape
    assert infos[0]["episode"]["l"] == 2
    assert infos[1] == {}
    still_world.state.illegal_contact[2] = True
    _, reward, done, infos = env.step(np.zeros((3, 12)))
    assert done.tolist() == [False, False, True] and infos[2]["TimeLimit.truncated"] is False
    assert reward.dtype == np.float32
