"""Distances between walks against cases that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.rl.walk_statistics import BANDS_HZ, Walk, band_power, log_figures, spectral_distance, torque_distance

TIME = np.arange(8000) / 1000.0


@pytest.mark.parametrize(("hertz", "band"), [(3.0, 1), (11.3, 3), (20.0, 4), (50.0, 5)])
def test_a_sine_lies_in_its_octave(hertz, band):
    power = band_power(3.0 * np.sin(2 * np.pi * hertz * TIME)[:, None], 1000.0)[:, 0]
    assert power[band] == pytest.approx(4.5, rel=0.02)
    assert np.delete(power, band).max() < 0.02 * power[band]


def test_white_noise_has_twice_the_power_in_every_next_octave():
    power = band_power(np.random.default_rng(0).normal(size=(60_000, 4)), 1000.0).mean(axis=1)
    np.testing.assert_allclose(power, np.diff(BANDS_HZ) / 500.0, rtol=0.15)


def test_spectra_do_not_depend_on_the_rate():
    slow = band_power(np.sin(2 * np.pi * 3.0 * TIME[::4])[:, None], 250.0)
    np.testing.assert_allclose(slow, band_power(np.sin(2 * np.pi * 3.0 * TIME)[:, None], 1000.0), atol=1e-3)


def test_twice_the_speed_is_six_decibels():
    power = np.full((6, 2), 0.5)
    np.testing.assert_allclose(spectral_distance(4.0 * power, power), 20.0 * np.log10(2.0), rtol=1e-5)
    assert np.isfinite(spectral_distance(power, 0.0 * power)).all()


def test_a_shifted_torque_is_as_far_as_the_shift():
    torque = np.random.default_rng(1).normal(0.0, 100.0, (5000, 2))
    np.testing.assert_allclose(torque_distance(torque + [7.0, -3.0], torque[::-1]), [7.0, 3.0], rtol=1e-9)


def walk(**changes):
    rng = np.random.default_rng(2)
    arrays = {name: rng.normal(size=(8000, 2)) for name in ("position_command", "position", "velocity", "effort")}
    return Walk(1000.0, **{**arrays, **changes})


def test_a_log_is_compared_with_itself_half_by_half():
    drifting = walk(effort=np.repeat([0.0, 10.0], 4000)[:, None] + np.zeros((8000, 2)))
    figures = log_figures([drifting], falls=0)
    np.testing.assert_allclose(figures.torque_distance, 10.0)
    assert figures.seconds == 8.0 and 0.0 < figures.spectral_distance.min()
    assert np.isnan(figures.body_velocity).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"effort": np.zeros((8000, 3))}, r"effort has shape \(8000, 3\), expected \(8000, 2\)"),
        ({"velocity": np.full((8000, 2), np.nan)}, "velocity holds a value that is not finite"),
        ({"body_velocity": np.zeros((7999, 3))}, r"body_velocity has shape \(7999, 3\)"),
    ],
)
def test_wrong_arrays_are_named(changes, words):
    with pytest.raises(UsageError, match=words):
        walk(**changes)
