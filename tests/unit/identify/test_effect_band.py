"""What is faster than the effects of a joint act is no error that one of them could have described."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.effect_band import effect_band, square_above
from hqpipe.identify.model import Samples

LENGTHS = (1200, 801)
SLOW, FAST = 0.01, 0.2  # cycles a sample


@pytest.fixture
def samples():
    trial = np.repeat(np.arange(len(LENGTHS)), LENGTHS)
    time = np.concatenate([0.001 * np.arange(n) for n in LENGTHS])
    return Samples(("a", "b"), trial, time, *[np.zeros(sum(LENGTHS))] * 4)


def _wave(samples, frequency):
    return np.sin(2.0 * np.pi * frequency * samples.time / 0.001)


def test_a_vibration_above_the_band_does_not_count_and_a_slow_error_does(samples):
    band = effect_band(3.0 + _wave(samples, SLOW), samples)
    assert SLOW <= band.highest < FAST
    slow, fast = _wave(samples, SLOW), _wave(samples, FAST)
    assert band.square(slow + fast) == pytest.approx(float(slow @ slow), rel=0.05)
    assert band.square(fast) < 0.02 * float(fast @ fast)


def test_the_whole_band_holds_the_whole_square(samples):
    error = np.random.default_rng(1).normal(size=len(samples.trial)) + 0.5
    band = effect_band(np.zeros(len(error)), samples)
    assert band.square(error) == pytest.approx(float(error @ error))
    assert band.share == pytest.approx(1.0)


def test_white_noise_lies_in_the_band_with_its_share(samples):
    error = np.random.default_rng(2).normal(size=len(samples.trial))
    band = effect_band(_wave(samples, 0.1), samples)
    assert band.share == pytest.approx(2.0 * band.highest, abs=0.01)
    assert band.square(error) == pytest.approx(band.share * len(error), rel=0.2)


def test_errors_that_overflow_are_infinite_in_every_band(samples):
    error = np.zeros(len(samples.trial))
    error[3] = np.inf
    assert effect_band(_wave(samples, SLOW), samples).square(error) == np.inf
    assert effect_band(error, samples).highest == 0.5


def test_only_what_is_faster_and_above_the_noise_is_above_the_band(samples):
    band = effect_band(_wave(samples, SLOW), samples)
    noise = 0.1 * np.random.default_rng(3).normal(size=len(samples.trial))
    slow, fast = _wave(samples, SLOW), _wave(samples, FAST)
    floor = float(noise @ noise)
    assert square_above(slow + fast + noise, band, floor) == pytest.approx(float(fast @ fast), rel=0.05)
    assert square_above(slow + noise, band, floor) < 0.2 * floor
    assert square_above(np.full(len(noise), np.inf), band, floor) == 0.0
