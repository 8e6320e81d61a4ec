from __future__ import annotations

import numpy as np
import pytest

from hqpipe.rl.commands import sample_commands
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
