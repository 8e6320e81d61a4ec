from __future__ import annotations

import numpy as np
import pytest

from hqpipe.rl.evaluate import Evaluation, evaluate, zero_actor
from hqpipe.rl.task import LocomotionTask
from hqpipe.rl.worlds import evaluation_world

COMMANDS = [(0.8, 0.0, 0.0), (0.0, 0.0, 0.0)]


def test_trot_alone_walks_forward_in_the_simulator(robot, actuator, spec, small):
    world = evaluation_world(robot, actuator, small, workers=1)
    task = LocomotionTask(robot, spec, world, small, training=False, seed=0)
    outcome = evaluate(zero_actor(12), task, COMMANDS, seconds=4.0)
    world.close()
    walking, standing = outcome.results
    assert outcome.falls == 0
    assert walking.velocity[0] == pytest.approx(0.8, abs=0.1)
    assert walking.foot_clearance > 0.05
    assert abs(standing.velocity[0]) < 0.01
    assert Evaluation.from_dict(outcome.to_dict()) == outcome


def test_speeds_and_falls_are_told_apart(robot, spec, still_world, small):
    task = LocomotionTask(robot, spec, still_world, small, training=False, seed=0)

    def actor(observation: np.ndarray) -> np.ndarray:
        s = still_world.state
        s.base_linear_velocity[:, 0] = [0.6, 0.1, 0.4]
        s.illegal_contact[:] = [False, True, False]
        return np.zeros((3, 12))

    outcome = evaluate(actor, task, COMMANDS, seconds=0.1)
    walking, standing = outcome.results
    assert (walking.falls, walking.robots) == (0, 2)
    assert walking.velocity[0] == pytest.approx(0.5)
    assert walking.error == pytest.approx((0.2 + 0.4) / 2)
    assert (standing.falls, standing.robots) == (1, 1)
    assert standing.error == pytest.approx(0.1)
    assert outcome.score == pytest.approx((0.3 + 1.0) / 2 + 1 / 3)


def test_push_comes_once_after_the_speeds_are_taken(robot, spec, still_world, small):
    task = LocomotionTask(robot, spec, still_world, small, training=False, seed=0)

    def actor(observation: np.ndarray) -> np.ndarray:
        still_world.state.base_linear_velocity[:, 0] = 5.0 if still_world.pushes else 0.8
        return np.zeros((3, 12))

    outcome = evaluate(actor, task, [(0.8, 0.0, 0.0)], seconds=0.3, push_speed=0.5)
    assert outcome.results[0].velocity[0] == pytest.approx(0.8)
    ((indices, impulse),) = still_world.pushes
    assert indices.tolist() == [0, 1, 2]
    np.testing.assert_allclose(np.linalg.norm(impulse, axis=1), 0.5 * 317.2, rtol=1e-3)
    assert len(np.unique(impulse[:, 0].round(3))) == 3
