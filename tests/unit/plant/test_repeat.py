"""Walks under one order: each its own way, all the same test, and the same again for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.plant.repeat import COURSE, POSTURE, WAVER, repeat
from hqpipe.robots import load_robot, robot_folder

SETTLED = 2.0  # s that judgements of a walk leave out


@pytest.fixture(scope="module")
def robot():
    return load_robot(robot_folder("hydraulic_quadruped"))


def numbers(one) -> np.ndarray:
    return np.array([*one.posture, one.heading, one.phase, one.wait, one.ramp, *one.waver_hz, *one.waver_phase])


def test_a_seed_is_one_walk_and_another_seed_another_in_every_respect(robot):
    first, again, other = repeat(robot, 1002), repeat(robot, 1002), repeat(robot, 1003)
    np.testing.assert_array_equal(numbers(first), numbers(again))
    assert (numbers(first) != numbers(other)).all()


def test_it_stays_the_same_test(robot):
    times = np.arange(SETTLED, 22.0, 1e-2)
    for seed in range(1000, 1020):
        one = repeat(robot, seed)
        assert np.abs(one.posture - robot.nominal_position).max() <= POSTURE and abs(one.heading) <= COURSE
        assert ((one.posture >= robot.position_lower) & (one.posture <= robot.position_upper)).all()
        order = one.command(1.0, 0.0, 0.0)
        assert order(0.0) == {"vx": 0.0, "vy": 0.0, "wz": 0.0}
        vx, vy = np.array([[order(t)["vx"], order(t)["vy"]] for t in times]).T
        assert np.abs(vx - 1.0).max() <= WAVER and np.abs(vy).max() <= WAVER, "the stick is where it should be"
        assert abs(vx.mean() - 1.0) < 0.01 and np.ptp(vx) > WAVER
        still = one.command(0.0, 0.0, 0.0)
        assert all(still(t) == {"vx": 0.0, "vy": 0.0, "wz": 0.0} for t in times[::100]), "nobody holds the stick"
