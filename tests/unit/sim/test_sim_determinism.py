"""Bit for bit: same seed, any number of workers, any neighbours, a reset in place."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.sim.randomisation import KinematicsRandomisation

ENVS, STEPS = 16, 40


def run(world, robot, snapshot, nominal, steps=STEPS):
    """Targets, pushes and resets from one seed; returns every number of every step."""
    rng = np.random.default_rng(5)
    history = []
    for k in range(steps):
        if k % 7 == 3:
            rows = rng.choice(ENVS, 3, replace=False)
            world.reset(rows, **nominal(3))
            world.apply_push(np.array([1, 9]), rng.normal(0.0, 30.0, (2, 3)))
        targets = robot.nominal_position + rng.uniform(-0.3, 0.3, (ENVS, 12))
        history.append(snapshot(world.step(targets)))
    return np.array(history)


def test_the_number_of_workers_does_not_matter(engine, make_world, robot, snapshot, nominal):
    options = {"engine": engine, "seed": 3, "randomisation": KinematicsRandomisation(variants=3, friction=0.2)}
    one = run(make_world(ENVS, workers=1, **options), robot, snapshot, nominal)
    two = run(make_world(ENVS, workers=2, **options), robot, snapshot, nominal)
    np.testing.assert_array_equal(one, two)
    assert np.isfinite(one).all() and np.ptp(one[-1], axis=0).max() > 0.1


def test_the_same_seed_gives_the_same_bytes(engine, make_world, robot, snapshot, nominal):
    options = {"engine": engine, "randomisation": KinematicsRandomisation(variants=2)}
    runs = [run(make_world(ENVS, seed=seed, **options), robot, snapshot, nominal, 10) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert (runs[0] != runs[2]).any()


@pytest.mark.parametrize("neighbours", ["still", "wild", "reset"])
def test_a_robot_does_not_notice_its_neighbours(engine, make_world, robot, snapshot, nominal, trot, neighbours):
    """Nor its own past: the same walk, alone from a new world and after a reset in place."""

    def walk(world, rng):
        history = []
        for k in range(60):
            targets = np.tile(robot.nominal_position, (world.num_envs, 1))
            if rng is not None:
                targets += rng.uniform(-0.5, 0.5, targets.shape)
            targets[row] = trot(0.01 * k)
            if neighbours == "reset" and k % 13 == 0 and world is crowd:
                world.reset(np.array([0, 5, 7]), **nominal(3))
            history.append(snapshot(world.step(targets), [row]))
        return np.array(history)

    row = 3
    crowd = make_world(8, engine=engine)
    alone = walk(make_world(row + 1, engine=engine), None)
    rng = None if neighbours == "still" else np.random.default_rng(1)
    np.testing.assert_array_equal(walk(crowd, rng), alone)
    crowd.reset(np.array([row]), **nominal(1))
    np.testing.assert_array_equal(walk(crowd, rng), alone)
    assert alone[-1, 0, 0] != alone[0, 0, 0]


def test_reset_forgets_torque_and_push(engine, make_world, robot, snapshot, nominal):
    world = make_world(2, engine=engine)
    targets = np.tile(robot.nominal_position, (2, 1)) + 0.1
    fresh = snapshot(world.step(targets)).copy()
    for _ in range(5):
        world.step(targets)
    world.apply_push(np.array([0, 1]), np.full((2, 3), 50.0))
    world.reset(np.array([0, 1]), **nominal(2))
    np.testing.assert_array_equal(snapshot(world.step(targets)), fresh)


def test_reset_forgets_the_contacts_of_a_robot_that_stands_where_it_is_put(
    engine, make_world, robot, snapshot, nominal
):
    """The feet come back to within millimetres of contacts that the engine may have kept, with their impulses."""
    world = make_world(1, engine=engine)

    def stand() -> np.ndarray:
        return np.array([snapshot(world.step(robot.nominal_position[None])) for _ in range(30)])

    fresh = stand()
    world.reset(np.array([0]), **nominal(1))
    np.testing.assert_array_equal(stand(), fresh)
