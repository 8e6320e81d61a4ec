"""Step, noise and holding of a signal, recovered from signals whose step, noise and holding are known."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.survey.signal import held, noise, resolution

TIME = np.arange(4000) * 1e-3
SINE = 0.4 * np.sin(2 * np.pi * 1.3 * TIME)


def noisy(sigma: float) -> np.ndarray:
    return SINE + sigma * np.random.default_rng(0).normal(size=len(SINE))


@pytest.mark.parametrize("step", [2 * np.pi / 4096, 0.01])
def test_the_step_of_an_encoder_is_recovered(step):
    assert resolution(np.round(noisy(1e-3) / step) * step) == pytest.approx(step, rel=1e-6)


def test_the_step_survives_single_precision():
    step = 2 * np.pi / 4096
    stored = (np.round(SINE / step) * step).astype(np.float32).astype(np.float64)
    assert resolution(stored) == pytest.approx(step, rel=1e-3)


def test_a_continuous_signal_has_no_step():
    assert resolution(noisy(1e-3)) is None
    assert resolution(np.zeros(100)) is None


@pytest.mark.parametrize("sigma", [1e-4, 1e-2])
def test_the_noise_is_recovered(sigma):
    assert noise(noisy(sigma), None) == pytest.approx(sigma, rel=0.06)


def test_noise_that_cannot_be_told_is_not_stated():
    assert noise(SINE, None) is None, "smooth"
    step = 0.01
    assert noise(np.round(noisy(0.2 * step) / step) * step, step) is None, "less than a step"
    rough = np.cumsum(np.random.default_rng(0).normal(size=4000))
    assert noise(rough, None) is None, "a random walk is motion"


def test_a_command_of_a_slower_controller_is_held():
    assert held(np.repeat(SINE[::10], 10), None) == 10
    assert held(SINE, None) is None


def test_a_slow_sensor_that_creeps_from_step_to_step_is_not_held():
    step = 2 * np.pi / 4096
    slow = np.round(0.2 * TIME / step) * step
    assert held(slow, resolution(slow)) is None
    assert held(np.repeat(noisy(0.05)[::4], 4), step) == 4
