from __future__ import annotations

import numpy as np
import pytest

from hqpipe.rl.commands import CommandRamps, sample_commands
from hqpipe.rl.config import CommandConfig


def test_commands_stay_in_range_and_keep_the_shares():
    config = CommandConfig(standing_share=0.2, straight_share=0.5)
    drawn = sample_commands(config, 20_000, np.random.default_rng(0))
    for axis, (low, high) in enumerate((config.vx, config.vy, config.wz)):
        assert drawn[:, axis].min() >= low and drawn[:, axis].max() <= high
    standing = (drawn == 0.0).all(axis=1)
    straight = (drawn[:, 1:] == 0.0).all(axis=1) & ~standing
    assert standing.mean() == pytest.approx(0.2, abs=0.01)
    assert straight.mean() == pytest.approx(0.4, abs=0.01)


def test_some_robots_only_turn_and_as_many_only_step_sideways():
    config = CommandConfig(standing_share=0.2, straight_share=0.25, in_place_share=0.5)
    moves = sample_commands(config, 20_000, np.random.default_rng(0)) != 0.0
    turning, sideways = ((moves == only).all(axis=1).mean() for only in ((False, False, True), (False, True, False)))
    assert turning == pytest.approx(0.2, abs=0.01)
    assert sideways == pytest.approx(0.2, abs=0.01)
    assert moves.all(axis=1).mean() == pytest.approx(0.2, abs=0.01)


def test_no_moving_command_is_slower_than_the_smallest():
    config = CommandConfig(standing_share=0.2, in_place_share=0.5, smallest=0.15)
    drawn = sample_commands(config, 20_000, np.random.default_rng(0))
    speed = np.linalg.norm(drawn, axis=1)
    assert (speed == 0.0).mean() == pytest.approx(0.2, abs=0.01)
    assert speed[speed > 0.0].min() >= 0.15
    sideways = np.abs(drawn[(drawn[:, 1] != 0.0) & (drawn[:, ::2] == 0.0).all(axis=1), 1])
    assert len(sideways) / len(drawn) == pytest.approx(0.2, abs=0.01)
    assert np.quantile(sideways, 0.5) == pytest.approx(0.225, abs=0.01)  # uniform from 0.15 to 0.3


def test_a_new_command_is_reached_on_a_straight_way_within_the_longest_time():
    ramps, rng = CommandRamps(200, 0.5), np.random.default_rng(0)
    every, goal = np.arange(200), np.tile([1.0, -0.2, 0.4], (200, 1))
    ramps.head_for(every, goal, rng)
    assert not ramps.command.any()
    told = []
    for _ in range(50):
        ramps.advance()
        told.append(ramps.command.copy())
    told = np.array(told)
    arrival = (told != goal).any(axis=2).sum(axis=0)
    assert arrival.min() < 5 and arrival.max() == 49  # periods of 10 ms before the last
    late = int(np.argmax(arrival))
    np.testing.assert_allclose(told[24, late], 0.5 * goal[0])
    np.testing.assert_array_equal(told[-1], goal)
    ramps.head_for(np.array([3]), np.array([[0.0, 0.0, 0.0]]), rng)
    ramps.stand(np.array([4]))
    ramps.head_for(np.array([4]), goal[:1], rng)
    ramps.advance()
    assert (ramps.command[[3, 4]] < goal[:2])[:, 0].all() and (ramps.command[5] == goal[0]).all()


def test_without_a_ramp_commands_change_at_once():
    ramps = CommandRamps(2, 0.0)
    ramps.head_for(np.array([1]), np.array([[1.0, 0.0, 0.0]]), np.random.default_rng(0))
    ramps.advance()
    assert ramps.command.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]


def test_without_random_numbers_all_take_half_of_the_longest_time():
    ramps = CommandRamps(2, 0.4)
    ramps.head_for(np.arange(2), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.5]]))
    for _ in range(10):
        ramps.advance()
    np.testing.assert_allclose(ramps.command, [[0.5, 0.0, 0.0], [0.0, 0.0, 0.25]])
    for _ in range(10):
        ramps.advance()
    assert ramps.command.tolist() == [[1.0, 0.0, 0.0], [0.0, 0.0, 0.5]]


def test_a_robot_that_is_told_to_stand_forgets_where_it_was_heading():
    ramps = CommandRamps(1, 0.4)
    ramps.head_for(np.array([0]), np.array([[1.0, 0.0, 0.0]]))
    ramps.advance()
    ramps.stand(np.array([0]))
    ramps.advance()
    assert not ramps.command.any()
