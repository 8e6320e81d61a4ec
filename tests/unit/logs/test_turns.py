"""Positions that start again after a turn are told from those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.turns import TURN, jumps, nearest_turn

TIME = np.arange(0.0, 20.0, 0.01)
MOTIONS = {
    "one way": 1.5 * TIME,
    "backwards": -0.9 * TIME,
    "to and fro over the seam": 4.0 * np.sin(0.7 * TIME) + 0.3,
    "fast": 60.0 * TIME,
}


@pytest.mark.parametrize("motion", list(MOTIONS))
@pytest.mark.parametrize("low", [0.0, -np.pi])
def test_a_wrapped_motion_is_joined(motion, low):
    angle = MOTIONS[motion] + 1e-4 * np.random.default_rng(0).normal(size=len(TIME))
    wrapped = low + np.mod(angle - low, TURN)
    joined = wrapped + TURN * jumps(wrapped)
    np.testing.assert_allclose(joined - joined[0], angle - angle[0], atol=1e-9)


@pytest.mark.parametrize(
    "position",
    [
        0.0 * TIME,
        3.0 * np.sin(TIME),
        np.where(TIME < 10, -2.0, 2.0),
        1.5 * TIME,
        np.where(TIME < 10, 0.0, TURN) + TIME,
        np.full(len(TIME), np.nan),
    ],
)
def test_other_motions_are_left_as_they_are(position):
    assert not jumps(position).any()


def test_missing_samples_hide_no_wrap():
    wrapped = np.mod(1.5 * TIME, TURN)
    wrapped[::7] = np.nan
    joined = wrapped + TURN * jumps(wrapped)
    present = np.isfinite(joined)
    np.testing.assert_allclose(joined[present], (1.5 * TIME)[present], atol=1e-9)


def test_a_command_follows_the_turn_of_the_position():
    angle = 1.5 * TIME
    np.testing.assert_allclose(nearest_turn(np.mod(angle + 0.2, TURN), angle), angle + 0.2, atol=1e-9)
