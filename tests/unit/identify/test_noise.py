"""Noise of a sensor under motion, impacts and rests."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.noise import sensor_noise
from hqpipe.logs.survey.signal import difference_noise


def test_rests_of_a_coarse_sensor_do_not_hide_its_noise():
    rng = np.random.default_rng(0)
    time = np.arange(20_000) / 1000.0
    moving = (time % 4.0) < 1.0
    phase = np.cumsum(np.where(moving, 0.05, 0.0))
    step = 0.01
    signal = np.round((np.sin(0.1 * phase) + np.where(moving, 0.02 * rng.normal(size=len(time)), 0.0)) / step) * step
    assert difference_noise(signal) == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize("sigma", [0.1, 5.0])
@pytest.mark.parametrize("estimate", [difference_noise, lambda signal: sensor_noise([signal])])
def test_noise_of_a_smooth_signal(estimate, sigma):
    t = np.arange(8000) * 1e-3
    signal = 200 * np.sin(9 * t) + 60 * np.sin(40 * t) + sigma * np.random.default_rng(0).normal(size=8000)
    assert estimate(signal) == pytest.approx(sigma, rel=0.25)
    signal[4000:4030] += 300.0
    assert estimate(signal) == pytest.approx(sigma, rel=0.25), "an impact is no noise"


def test_drifts_are_no_noise_and_units_do_not_matter():
    rng = np.random.default_rng(1)
    drift = 0.1 * np.cumsum(rng.normal(size=20_000))
    signal = drift + 2.0 * rng.normal(size=20_000)
    assert sensor_noise([signal]) == pytest.approx(2.0, rel=0.05)
    assert sensor_noise([1e3 * signal]) == pytest.approx(1e3 * sensor_noise([signal]), rel=1e-6)
