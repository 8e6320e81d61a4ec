"""Noise of a sensor under motion, impacts and rests."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.survey.signal import difference_noise


def test_rests_of_a_coarse_sensor_do_not_hide_its_noise():
    rng = np.random.default_rng(0)
    time = np.arange(20_000) / 1000.0
    moving = (time % 4.0) < 1.0
    phase = np.cumsum(np.where(moving, 0.05, 0.0))
    step = 0.01
    signal = np.round((np.sin(0.1 * phase) + np.where(moving, 0.02 * rng.normal(size=len(time)), 0.0)) / step) * step
    assert difference_noise([signal]) == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize("sigma", [0.1, 5.0])
def test_noise_of_a_smooth_signal(sigma):
    t = np.arange(8000) * 1e-3
    signal = 200 * np.sin(9 * t) + 60 * np.sin(40 * t) + sigma * np.random.default_rng(0).normal(size=8000)
    assert difference_noise([signal]) == pytest.approx(sigma, rel=0.1)
    signal[4000:4030] += 300.0
    assert difference_noise([signal]) == pytest.approx(sigma, rel=0.1), "an impact is no noise"


def test_drifts_are_no_noise_and_units_do_not_matter():
    rng = np.random.default_rng(1)
    drift = 0.1 * np.cumsum(rng.normal(size=20_000))
    signal = drift + 2.0 * rng.normal(size=20_000)
    assert difference_noise([signal]) == pytest.approx(2.0, rel=0.05)
    assert difference_noise([1e3 * signal]) == pytest.approx(1e3 * difference_noise([signal]), rel=1e-6)


def test_motion_that_the_rate_hardly_resolves_is_no_noise_where_the_machine_is_calm_at_times():
    rng = np.random.default_rng(2)
    time = np.arange(2000) * 0.01
    shaken = np.where(time % 4.0 < 2.8, np.sin(2.0 * np.pi * 21.0 * time) + np.sin(2.0 * np.pi * 37.0 * time), 0.0)
    signal = 5.0 * np.sin(time) + 2.0 * shaken + 0.05 * rng.normal(size=len(time))
    assert difference_noise([signal[:900], signal[900:]]) == pytest.approx(0.05, rel=0.3)


def test_slow_motion_of_a_coarse_sensor_shows_its_rounding():
    time = np.arange(5000) * 1e-3
    step = 0.5
    signal = np.round(9.0 * np.sin(0.7 * time) / step) * step
    assert difference_noise([signal]) == pytest.approx(step / np.sqrt(12.0), rel=0.1)
    assert difference_noise(np.split(signal, 500)) == pytest.approx(step / np.sqrt(12.0), rel=0.1), "in short stretches"


def test_a_constant_shows_no_noise():
    assert difference_noise([np.full(300, 2.5), np.zeros(0)]) == 0.0
    assert difference_noise([]) == 0.0


def test_a_few_samples_are_judged_by_the_differences_that_they_have():
    assert difference_noise([np.array([0.0, 1.0, 0.0, 1.0, 0.0])]) > 0.5
