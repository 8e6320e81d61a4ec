"""Errors of free runs without the noise of the torque at the start of each window."""

import numpy as np
import pytest
from scipy.linalg import block_diag, fractional_matrix_power

from hqpipe.layers.actuator.start_noise import StartNoise

NOISE, LEAK, WINDOWS = 2.0, 0.1, 400
STEP = np.arange(1, 21)
WHOLE = np.ones((WINDOWS, len(STEP)), dtype=bool)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def left(leak):
    return (1.0 - leak) ** STEP


def errors(rng, leak):
    """(W, S) of a law that is right but for its leak, which the torque at the start of each window has decayed by."""
    start = rng.normal(0.0, 20.0, (WINDOWS, 1))
    noise = rng.normal(0.0, NOISE, (WINDOWS, len(STEP) + 1))
    return (start + noise[:, :1]) * left(leak) - start * left(LEAK) - noise[:, 1:]


def test_errors_have_the_likelihood_of_their_covariance(rng):
    judged = rng.random((5, len(STEP))) > 0.3
    error, share = rng.normal(size=judged.sum()), 0.7
    covariance = block_diag(*(np.eye(m.sum()) + share * np.outer(left(LEAK)[m], left(LEAK)[m]) for m in judged))
    expected = fractional_matrix_power(covariance, -0.5) @ error * np.linalg.det(covariance) ** (0.5 / len(error))
    removed = StartNoise(NOISE**2, STEP, judged).removed_from(error, LEAK, share)
    np.testing.assert_allclose(removed, expected, rtol=1e-10)


def test_a_law_that_forgets_the_start_sooner_does_not_err_less():
    noise, leaks = StartNoise(NOISE**2, STEP, WHOLE), np.linspace(0.08, 0.14, 61)
    runs = [errors(np.random.default_rng(7), leak).ravel() for leak in leaks]  # of the same windows
    raw = [e @ e for e in runs]
    removed = [
        (r := noise.removed_from(e, leak, noise.share(e, leak))) @ r for e, leak in zip(runs, leaks, strict=True)
    ]
    assert abs(leaks[np.argmin(removed)] - LEAK) <= 1.5e-3
    assert leaks[np.argmin(raw)] > leaks[np.argmin(removed)]


def test_the_floor_is_what_the_noise_leaves(rng):
    noise = StartNoise(NOISE**2, STEP, WHOLE)
    error = errors(rng, LEAK).ravel()
    removed = noise.removed_from(error, LEAK, noise.share(error, LEAK))
    of_error, of_removed = noise.floor(LEAK)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(of_error, rel=0.03)
    assert np.sqrt(np.mean(removed**2)) == pytest.approx(of_removed, rel=0.03)


def test_large_errors_and_a_perfect_sensor_leave_the_errors_alone(rng):
    error = 1e4 * rng.normal(size=WHOLE.size)
    noise = StartNoise(NOISE**2, STEP, WHOLE)
    np.testing.assert_allclose(noise.removed_from(error, LEAK, noise.share(error, LEAK)), error, rtol=1e-3, atol=1e-2)
    perfect = StartNoise(0.0, STEP, WHOLE)
    assert perfect.share(error, LEAK) == 0.0
    assert perfect.removed_from(error, LEAK, 0.0) is error


@pytest.mark.parametrize("error", [np.zeros(WHOLE.size), np.full(WHOLE.size, np.inf)])
def test_no_error_and_an_endless_one_have_no_share_of_noise(error):
    assert StartNoise(NOISE**2, STEP, WHOLE).share(error, LEAK) == 0.0


def test_all_that_leaks_in_one_sample_leaves_nothing_of_the_start(rng):
    error = rng.normal(size=WHOLE.size)
    np.testing.assert_array_equal(StartNoise(NOISE**2, STEP, WHOLE).removed_from(error, 1.0, 1.0), error)
