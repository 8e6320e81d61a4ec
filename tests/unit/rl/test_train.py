from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from hqpipe.errors import ConfigError, DivergedError
from hqpipe.rl import train as training
from hqpipe.rl.config import ActuatorRandomisationConfig, from_mapping
from hqpipe.rl.limits import LIMITS, Limit
from hqpipe.rl.mirror import mirror_joints, mirror_layout
from hqpipe.rl.observation import observation_layout
from hqpipe.rl.train import train
from hqpipe.rl.worlds import training_world, unmodelled_actuator


class Killed(Exception):
    pass


@pytest.fixture(scope="module")
def result(robot, actuator, small):
    return train(robot, actuator, small, workers=1)


def same_weights(first, second) -> bool:
    a, b = first.state_dict(), second.state_dict()
    return a.keys() == b.keys() and all(torch.equal(a[k], b[k]) for k in a)


def test_one_row_per_iteration_with_the_field_s_names(result, small):
    assert [row["iteration"] for row in result.rows] == list(range(1, small.iterations + 1))
    for key in ("train/approx_kl", "train/explained_variance", "rollout/ep_len_mean", "reward/tracking"):
        assert key in result.rows[-1]
    assert [i + 1 for i, row in enumerate(result.rows) if "eval/score" in row] == [3, 6]
    assert result.rows[-1]["time/total_timesteps"] == small.iterations * small.rollout_size


def test_actor_waits_for_the_critic(result):
    assert result.rows[0]["train/approx_kl"] == 0.0
    assert result.rows[-1]["train/approx_kl"] > 0.0


def test_the_estimator_learns_in_as_many_passes_as_it_is_told(robot, actuator, small):
    config = replace(small, ppo=replace(small.ppo, estimator_epochs=1))
    options = {"control_mode": "position", "scratch": None, "report": None, "posterior": None, "stiffness": None}
    trainer = training.Trainer(robot, actuator, config, workers=1, **options)
    trainer.run()
    policy, batches = trainer.model.policy, small.iterations * small.rollout_size // small.ppo.batch_size
    estimator, critic = (
        int(next(iter(optimizer.state.values()))["step"])
        for optimizer in (policy.estimator_optimizer, policy.critic_optimizer)
    )
    assert (estimator, critic) == (batches, small.ppo.n_epochs * batches)


def test_best_evaluation_belongs_to_the_returned_networks(result):
    scores = {row["iteration"]: row["eval/score"] for row in result.rows if "eval/score" in row}
    assert result.best_iteration == min(scores, key=scores.get)
    assert result.best.score == pytest.approx(min(scores.values()), abs=1e-12)


def both_ways(networks, robot, small) -> tuple[torch.Tensor, torch.Tensor]:
    """The mirror image of the actions, and the actions for the mirror image of what was seen."""
    seen = torch.randn(5, networks.normalise_observation.offset.numel(), generator=torch.Generator().manual_seed(0))
    image = mirror_layout(observation_layout(robot, small.gait.prior), robot.feet)
    joints = mirror_joints(robot.feet)
    with torch.no_grad():
        own, other = (networks.action(x) for x in (seen, seen[:, image.order] * torch.as_tensor(image.sign)))
    return own[:, joints.order] * torch.as_tensor(joints.sign), other


def test_a_policy_stays_symmetric_while_it_learns(robot, small, result):
    mirrored, other = both_ways(result.networks, robot, small)
    torch.testing.assert_close(mirrored, other, atol=1e-5, rtol=1e-4)


def test_a_policy_that_need_not_be_symmetric_is_not(robot, actuator, small):
    free = replace(small, policy=replace(small.policy, symmetric=False))
    networks = train(robot, actuator, free, workers=1).networks
    mirrored, other = both_ways(networks, robot, small)
    assert not torch.allclose(mirrored, other, atol=1e-3)


def test_the_odometry_estimator_learns_beside_the_policy(robot, actuator, small):
    """Its loss falls within a few updates, and what comes out is still symmetric."""
    config = replace(small, policy=replace(small.policy, leg_odometry=True))
    found = train(robot, actuator, config, workers=1)
    losses = [row["train/estimator_loss"] for row in found.rows]
    assert found.spec.leg_odometry and losses[-1] < 0.9 * losses[0]
    mirrored, other = both_ways(found.networks, robot, small)
    torch.testing.assert_close(mirrored, other, atol=1e-5, rtol=1e-4)


def test_exploration_narrows_to_its_bound(result, small):
    stds = [row["train/std"] for row in result.rows]
    assert stds[-1] == pytest.approx(math.exp(small.policy.final_log_std), rel=0.02)  # of the last update, too
    assert all(wide > narrow for wide, narrow in pairwise(stds))


def test_same_seed_same_weights_and_another_seed_others(robot, actuator, small, result):
    again = train(robot, actuator, small, workers=2)
    assert again.rows == result.rows
    assert same_weights(again.networks, result.networks)
    other = train(robot, actuator, replace(small, seed=2), workers=1)
    assert not same_weights(other.networks, result.networks)


def test_killed_training_ends_like_an_uninterrupted_one(robot, actuator, small, result, tmp_path):
    def kill_in_the_fourth_iteration(done: int, total: int, note: str) -> None:
        if done >= 4 * small.rollout_size + 1:
            raise Killed

    with pytest.raises(Killed):
        train(robot, actuator, small, scratch=tmp_path, progress=kill_in_the_fourth_iteration, workers=1)
    resumed = train(robot, actuator, small, scratch=tmp_path, workers=1)
    assert resumed.resumed_from == 4
    assert resumed.rows == result.rows
    assert same_weights(resumed.networks, result.networks)
    assert resumed.baseline == result.baseline


def two_engines(small):
    """Four iterations in the first engine, the checkpoints every two, and evaluations every one."""
    evaluation = replace(small.evaluation, interval=1)
    return replace(small, engine="pybullet", first_engine="mujoco", first_share=0.8, evaluation=evaluation)


def test_a_training_changes_its_engine_at_a_checkpoint(robot, actuator, small, result):
    config = two_engines(small)
    assert (small.iterations, small.checkpoint_interval, config.first_iterations) == (6, 2, 4)
    found = train(robot, actuator, config, workers=1)
    assert found.best_iteration > 4 and found.best.score == min(row["eval/score"] for row in found.rows[4:])
    assert found.baseline == train(robot, actuator, replace(small, engine="pybullet"), workers=1).baseline
    assert found.baseline != result.baseline
    rewards = [[row["rollout/reward_mean"] for row in rows] for rows in (found.rows, result.rows)]
    assert rewards[0][:4] == rewards[1][:4] and rewards[0][4] != rewards[1][4]


@pytest.mark.parametrize("killed_after", [2, 4, 5])
def test_a_training_that_was_killed_goes_on_in_its_engine(robot, actuator, small, tmp_path, killed_after):
    config = two_engines(small)

    def kill(done: int, total: int, note: str) -> None:
        if done >= killed_after * small.rollout_size + 1:
            raise Killed

    with pytest.raises(Killed):
        train(robot, actuator, config, scratch=tmp_path, progress=kill, workers=1)
    resumed, whole = train(robot, actuator, config, scratch=tmp_path, workers=1), train(robot, actuator, config)
    assert resumed.resumed_from == 2 * (killed_after // 2)
    assert resumed.rows == whole.rows
    assert same_weights(resumed.networks, whole.networks)
    assert (resumed.baseline, resumed.best_iteration) == (whole.baseline, whole.best_iteration)


def test_checkpoint_of_another_training_is_left_alone(robot, actuator, small, tmp_path):
    train(robot, actuator, small, scratch=tmp_path, workers=1)
    other = train(robot, actuator, replace(small, seed=5), scratch=tmp_path, workers=1)
    assert other.resumed_from == 0


@pytest.mark.parametrize("prior", ["none", "clock"])
def test_every_prior_trains(robot, actuator, small, prior):
    short = from_mapping(small, {"gait": {"prior": prior}, "total_steps": 80})
    outcome = train(robot, actuator, short, workers=1)
    assert outcome.spec.observation.size == (42 if prior == "none" else 44)
    assert outcome.spec.has_clock == (prior == "clock")


def test_torque_control_trains_against_the_ideal_torque(robot, small):
    outcome = train(
        robot, unmodelled_actuator(robot, "torque"), replace(small, total_steps=80), control_mode="torque", workers=1
    )
    assert outcome.spec.control_mode == "torque"
    assert outcome.spec.position_stiffness[0] == robot.torque_pd.kp


def test_a_training_that_diverges_says_so(robot, actuator, small, monkeypatch):
    monkeypatch.setitem(LIMITS, "reward.scale", Limit(0.0, 1e300, "no limit, so that it diverges"))
    with (
        np.errstate(over="ignore"),
        pytest.raises(DivergedError, match="not finite; lower ppo.learning_rate") as raised,
    ):
        train(robot, actuator, from_mapping(small, {"reward": {"scale": 1e300}}), workers=1)  # more than float32 holds
    assert raised.value.rows == []


def test_the_trot_may_compensate_another_stiffness_than_the_actuator_s(robot, actuator, small):
    short = replace(small, total_steps=40)
    given = np.full(len(robot.joints), 5000.0)
    spec = train(robot, actuator, short, workers=1, stiffness=given).spec
    np.testing.assert_array_equal(spec.position_stiffness, given)
    with pytest.raises(ConfigError, match="does not push a held joint back"):
        train(robot, actuator, short, workers=1, stiffness=np.zeros(len(robot.joints)))


def test_progress_counts_environment_steps(robot, actuator, small):
    calls = []
    train(robot, actuator, small, progress=lambda *a: calls.append(a), workers=1)
    assert [c[0] for c in calls] == [small.rollout_size * (i + 1) for i in range(small.iterations)]
    assert {c[1] for c in calls} == {small.iterations * small.rollout_size}


def test_worlds_are_closed_when_training_fails(robot, actuator, small, monkeypatch):
    closed = []
    monkeypatch.setattr(training.Trainer, "close", lambda self: closed.append(True))

    def fail(*_: object) -> None:
        raise Killed

    with pytest.raises(Killed):
        train(robot, actuator, small, progress=fail, workers=1)
    assert closed


def test_training_world_without_randomisation_has_exact_robots(robot, actuator, small):
    off = replace(
        small,
        randomisation=replace(
            small.randomisation, kinematics=0.0, friction=0.0, actuator=ActuatorRandomisationConfig("none")
        ),
    )
    world = training_world(robot, actuator, off, num_envs=2, workers=1, seed=0)
    state = world.step(np.tile(robot.nominal_position, (2, 1)))
    np.testing.assert_array_equal(state.joint_position[0], state.joint_position[1])
    world.close()
