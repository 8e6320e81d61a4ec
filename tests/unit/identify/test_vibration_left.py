"""A vibration that a law leaves is told from other errors, from noise, and from what goes on while the joint stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.identify.model import Samples
from hqpipe.identify.vibration_left import vibration_left

DT, LENGTH, WINDOW = 0.005, 4000, 20
TIME = DT * np.arange(LENGTH)
STROKE = np.where(TIME % 2.0 < 1.0, np.sin(np.pi * (TIME % 2.0)), 0.0)
SAMPLES = Samples(
    ("a",),
    np.zeros(LENGTH, dtype=np.int64),
    TIME,
    np.zeros(LENGTH),
    STROKE,
    10.0 * np.sin(2.0 * np.pi * 0.3 * TIME),
    np.repeat(np.arange(LENGTH // WINDOW, dtype=np.float64), WINDOW),
)
NOISE = 0.1 * np.random.default_rng(0).standard_normal(LENGTH)
SLIDES = STROKE > 0.1


@pytest.mark.parametrize("frequency", [60.0, 90.0, 140.0, 250.0])
def test_a_vibration_while_the_joint_slides_is_told(frequency):
    """A log of 200 Hz folds the last two down to 60 and 50 Hz."""
    found = vibration_left(NOISE + 5.0 * SLIDES * np.sin(2.0 * np.pi * (frequency * TIME + 0.3 * STROKE)), SAMPLES)
    assert found.sliding == pytest.approx(5.0 / np.sqrt(2.0), rel=0.1)
    assert found.standing == pytest.approx(0.1, rel=0.2)
    assert "vibrates by 3." in found.text("N·m") and "while it stands" in found.text("N·m")


def test_it_may_be_there_at_low_speeds_only():
    slow = SLIDES & (STROKE < 0.5)
    assert vibration_left(NOISE + 6.0 * slow * np.sin(2.0 * np.pi * 140.0 * TIME), SAMPLES)


def test_what_goes_on_while_the_joint_stands_is_none():
    assert vibration_left(NOISE + 5.0 * np.sin(2.0 * np.pi * 140.0 * TIME), SAMPLES) is None


def test_one_that_is_folded_down_to_motion_cannot_be_told_from_it():
    assert vibration_left(NOISE + 5.0 * SLIDES * np.sin(2.0 * np.pi * 225.0 * TIME), SAMPLES) is None


def test_errors_that_are_as_large_while_the_joint_stands_are_none():
    beside = 5.0 * np.sin(2.0 * np.pi * 0.9 * TIME)
    vibrates = 4.0 * SLIDES * np.sin(2.0 * np.pi * 140.0 * TIME)
    assert vibration_left(NOISE + vibrates, SAMPLES)
    assert vibration_left(NOISE + vibrates + beside, SAMPLES) is None


def test_a_law_that_lacks_something_slower_is_none():
    assert vibration_left(NOISE + 6.0 * SLIDES * np.sin(2.0 * np.pi * 12.0 * TIME), SAMPLES) is None


def test_shocks_are_none():
    shocks = 60.0 * SLIDES * (np.arange(LENGTH) % 40 == 0)
    assert vibration_left(NOISE + shocks, SAMPLES) is None


def test_a_weak_one_is_not_told():
    assert vibration_left(NOISE + 1.0 * SLIDES * np.sin(2.0 * np.pi * 140.0 * TIME), SAMPLES) is None


def test_where_a_window_begins_anew_nothing_is_taken_for_change():
    begins = np.where(np.arange(LENGTH) // WINDOW % 2 == 0, 8.0, -8.0) * SLIDES
    assert vibration_left(NOISE + begins, SAMPLES) is None


def test_a_joint_that_never_stands_and_one_without_samples_show_nothing():
    error = NOISE + 5.0 * np.sin(2.0 * np.pi * 140.0 * TIME)
    assert vibration_left(error, replace(SAMPLES, velocity=np.ones(LENGTH))) is None
    assert vibration_left(np.zeros(0), SAMPLES.only(np.zeros(LENGTH, dtype=bool))) is None
    assert vibration_left(error, replace(SAMPLES, output=np.ones(LENGTH))) is None
