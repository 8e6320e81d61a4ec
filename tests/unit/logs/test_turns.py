"""Positions that start again after a turn are told from those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.turns import TURN, encoder_range, jumps, nearest_turn

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
    assert encoder_range(TIME, wrapped) == TURN
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
    assert not jumps(position).any() and encoder_range(TIME, position) is None


def test_missing_samples_hide_no_wrap():
    wrapped = np.mod(1.5 * TIME, TURN)
    wrapped[::7] = np.nan
    joined = wrapped + TURN * jumps(wrapped)
    present = np.isfinite(joined)
    np.testing.assert_allclose(joined[present], (1.5 * TIME)[present], atol=1e-9)


def test_a_command_follows_the_turn_of_the_position():
    angle = 1.5 * TIME
    np.testing.assert_allclose(nearest_turn(np.mod(angle + 0.2, TURN), angle), angle + 0.2, atol=1e-9)


def wrapped(angle: np.ndarray, size: float, noise: float = 1e-4) -> np.ndarray:
    return np.mod(angle + noise * np.random.default_rng(1).normal(size=len(angle)) + 0.5 * size, size) - 0.5 * size


SWING = 40.0 * np.sin(0.7 * TIME)
SPIN = 9.0 * TIME + 2.0 * np.sin(0.5 * TIME)


@pytest.mark.parametrize("size", [25.0, 4.0 * np.pi, TURN / 9.0])
def test_the_range_of_an_encoder_is_told_by_jumps_both_ways(size):
    angle = SWING * size / 25.0
    found = encoder_range(TIME, wrapped(angle, size))
    assert found == pytest.approx(size, rel=1e-3)
    joined = wrapped(angle, size) + found * jumps(wrapped(angle, size), found)
    np.testing.assert_allclose(joined - joined[0], angle - angle[0], atol=5e-3 * size)


@pytest.mark.parametrize("factor", [1.0, -180.0 / np.pi])
def test_a_speed_tells_the_range_of_a_joint_that_spins_one_way(factor):
    position, speed = wrapped(SPIN, 25.0), factor * np.gradient(SPIN, TIME)
    assert encoder_range(TIME, position, speed) == pytest.approx(25.0, rel=1e-3)
    assert encoder_range(TIME, position) is None  # a motion that flies back looks the same
    assert encoder_range(TIME, position, factor * np.gradient(position, TIME)) is None  # and the speed shows it
    assert encoder_range(TIME, position, np.random.default_rng(0).normal(size=len(TIME))) is None


def test_rows_that_lack_hide_no_range():
    position, keep = wrapped(SWING, 25.0), np.ones(len(TIME), bool)
    keep[[300, 301, 302, 900, 901]] = False
    position[::50] = np.nan
    assert encoder_range(TIME[keep], position[keep]) == pytest.approx(25.0, rel=1e-3)


def glitches(angle: np.ndarray, to: float) -> np.ndarray:
    faulty = angle.copy()
    faulty[::150] = to
    return faulty


def repeated(stroke: np.ndarray) -> np.ndarray:
    return np.resize(stroke, len(TIME))


FAULTS = {
    "end to end within a sample": 12.0 * np.sign(np.sin(2.0 * TIME)) + 0.05 * np.sin(40.0 * TIME),
    "end to end, creeping": 12.0 * np.sign(np.sin(2.0 * TIME)) + 0.2 * np.cos(2.0 * TIME),
    "single samples at an end": glitches(SWING, -45.0),
    "its sign is lost now and then": SWING * np.where(np.mod(TIME, 3.0) < 1.5, 1.0, -1.0),
    "trials one behind the other": repeated(np.linspace(-12.0, 12.0, 500) ** 3 / 144.0),
    "blocks in another order": SWING.reshape(10, -1)[[3, 0, 7, 1, 9, 2, 5, 4, 8, 6]].ravel(),
    "noise of a count": np.random.default_rng(0).integers(0, 2, len(TIME)) * 1e-3,
    "an offset for a while": 0.2 * np.sin(TIME) + np.where(np.mod(TIME, 4.0) < 2.0, 0.0, 10.0),
}


@pytest.mark.parametrize("name", list(FAULTS))
def test_faults_and_fast_motions_are_no_range(name):
    position = FAULTS[name] + 1e-4 * np.random.default_rng(1).normal(size=len(TIME)) * (name != "noise of a count")
    assert encoder_range(TIME, position) is None
    assert encoder_range(TIME, position, np.gradient(position, TIME)) is None
    assert encoder_range(TIME, position, np.gradient(SWING, TIME)) is None
