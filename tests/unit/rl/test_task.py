from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.rl.config import TrainConfig, from_mapping
from hqpipe.rl.task import LocomotionTask

ACTIONS = np.zeros((3, 12))


def make_task(robot, spec, world, config: TrainConfig, *, training: bool = True) -> LocomotionTask:
    task = LocomotionTask(robot, spec, world, config, training=training, seed=3)
    task.reset()
    return task


def test_observation_holds_what_the_names_say(robot, spec, still_world, small):
    task = make_task(robot, spec, still_world, small, training=False)
    task.set_commands(np.tile([0.7, 0.1, -0.2], (3, 1)))
    still_world.state.joint_velocity[1, 4] = 2.5
    seen = task.observe()
    assert seen.shape == (3, spec.observation.size + spec.state.size)
    np.testing.assert_allclose(seen[0, spec.observation.part("velocity_command")], [0.7, 0.1, -0.2], rtol=1e-6)
    assert seen[1, spec.observation.part("joint_velocity")][4] == 2.5
    height = spec.observation.size + spec.state.part("base_height").start
    assert seen[0, height] == pytest.approx(robot.nominal_height, abs=0.01)


def test_targets_are_clipped_and_remembered(robot, spec, still_world, small):
    task = make_task(robot, spec, still_world, small, training=False)
    task.step(np.full((3, 12), 100.0))
    sent = still_world.targets[-1]
    np.testing.assert_allclose(sent, np.tile(robot.position_upper, (3, 1)))
    seen = task.observe()[:, spec.observation.part("previous_target")]
    np.testing.assert_allclose(seen, sent, rtol=1e-6)


def test_error_of_the_mean_motion_forgets_a_sway_and_keeps_what_lasts(robot, spec, still_world, small):
    task = make_task(robot, spec, still_world, small, training=False)
    task.set_commands(np.tile([0.7, 0.0, 0.2], (3, 1)))
    cycle = round(100.0 / small.gait.frequency_hz)
    for i in range(10 * cycle):
        still_world.state.base_linear_velocity[:, 0] = 0.6 + 0.2 * np.sin(2.0 * np.pi * i / cycle)
        task.step(ACTIONS)
    np.testing.assert_allclose(task.mean_error, np.tile([0.1, 0.0, 0.2], (3, 1)), atol=0.04)
    task.reset()
    assert not task.mean_error.any()


def test_fall_ends_the_episode_once_with_its_penalty(robot, spec, still_world, small):
    quiet = from_mapping(small, {"randomisation": {"push_interval_s": 0.0}, "reward": {"fall": -5.0}})
    task = make_task(robot, spec, still_world, quiet)
    usual = task.step(ACTIONS)
    still_world.state.illegal_contact[1] = True
    before = len(still_world.resets)
    outcome = task.step(ACTIONS)
    assert outcome.fell.tolist() == [False, True, False]
    assert not outcome.timed_out.any()
    assert outcome.reward[1] < usual.reward[1] - 4.0
    assert still_world.resets[before:] == [[1]]
    assert task.steps.tolist() == [2, 0, 2]


def test_time_limit_keeps_the_last_observation(robot, spec, still_world, small):
    config = replace(small, episode_s=0.03)
    task = make_task(robot, spec, still_world, config)
    outcomes = [task.step(ACTIONS) for _ in range(3)]
    assert [o.timed_out.all() for o in outcomes] == [False, False, True]
    last = outcomes[-1]
    joints = spec.observation.part("joint_position")
    assert not np.array_equal(last.final_observation[:, joints], last.observation[:, joints])
    assert not last.fell.any()


def test_broken_physics_counts_as_a_fall(robot, spec, still_world, small):
    task = make_task(robot, spec, still_world, small)
    still_world.state.joint_position[2] = np.nan
    outcome = task.step(ACTIONS)
    assert outcome.fell.tolist() == [False, False, True]
    assert np.isfinite(outcome.observation).all()
    assert np.isfinite(outcome.final_observation).all()
    assert outcome.reward[2] == pytest.approx(small.reward.fall)
    assert np.isfinite(outcome.reward).all()


def test_pushes_have_the_size_and_rate_asked_for(robot, spec, still_world, small):
    config = from_mapping(small, {"episode_s": 20.0, "randomisation": {"push_interval_s": 0.05, "push_speed": 0.4}})
    task = make_task(robot, spec, still_world, config)
    for _ in range(200):
        task.step(ACTIONS)
    impulses = np.concatenate([impulse for _, impulse in still_world.pushes])
    assert len(impulses) == pytest.approx(3 * 200 * 0.2, rel=0.3)
    assert 300.0 * 0.3 < np.abs(impulses[:, :2]).max() <= 0.4 * 317.3
    assert (impulses[:, 2] == 0.0).all()


def test_evaluation_is_free_of_randomness(robot, spec, still_world, small):
    seen = []
    for seed in (3, 4):
        task = LocomotionTask(robot, spec, still_world, small, training=False, seed=seed)
        task.reset()
        task.set_commands(np.tile([1.0, 0.0, 0.0], (3, 1)))
        seen.append(task.step(ACTIONS).observation)
    np.testing.assert_array_equal(*seen)
    np.testing.assert_array_equal(seen[1], task.observe())
    assert not still_world.pushes


@pytest.mark.parametrize(
    ("at_once", "curriculum", "stands"), [(True, 0.5, True), (False, 0.5, False), (False, 1.0, True)]
)
def test_standing_may_be_commanded_later_than_all_else(robot, spec, still_world, small, at_once, curriculum, stands):
    config = replace(small, command=replace(small.command, standing_share=1.0, standing_at_once=at_once))
    task = LocomotionTask(robot, spec, still_world, config, training=True, seed=3)
    task.curriculum = curriculum
    task.reset()
    assert (task.command == 0.0).all(axis=1).tolist() == [stands] * 3


def test_with_a_ramp_an_episode_begins_from_standing(robot, spec, still_world, small):
    command = replace(small.command, ramp_s=0.5, resample_s=3600.0, standing_share=0.0, smallest=0.15)
    task = LocomotionTask(robot, spec, still_world, replace(small, command=command), training=True, seed=3)
    task.reset()
    assert not task.command.any()
    for _ in range(50):
        task.step(ACTIONS)
    assert (np.linalg.norm(task.command, axis=1) >= 0.15).all()


def test_same_seed_same_numbers(robot, spec, still_world, small):
    runs = []
    for _ in range(2):
        task = make_task(robot, spec, type(still_world)(robot, 3), small)
        runs.append([task.step(ACTIONS).observation for _ in range(40)])
    np.testing.assert_array_equal(runs[0], runs[1])
