"""Noise of a coarse sensor on a joint that rests most of the time."""

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
    assert difference_noise(signal) == pytest.approx(0.02, rel=0.3)
