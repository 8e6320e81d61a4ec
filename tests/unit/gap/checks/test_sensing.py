"""Channels against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import plant_logs, real, values

from hqpipe.gap.checks.sensing import channel_warnings, lags, skew


def late(trajectory, samples):
    effort = trajectory.effort
    shifted = np.concatenate([effort[:1].repeat(samples, axis=0), effort[:-samples]])
    return replace(trajectory, effort=shifted)


@pytest.mark.parametrize("delay", [0.0013, -0.0026, 0.011])
def test_skew_is_found_to_a_fraction_of_a_sample(delay):
    time = np.arange(4000) * 1e-3
    rng = np.random.default_rng(0)
    parts = [
        (a, f, p) for a, f, p in zip(rng.uniform(1, 2, 8), rng.uniform(1, 20, 8), rng.uniform(0, 6, 8), strict=True)
    ]

    def wave(t):
        return sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in parts)

    measured = 3.0 * wave(time - delay) + 7.0 + 0.5 * rng.standard_normal(4000)
    assert skew([(wave(time)[:, None], measured)], 1e-3) == pytest.approx(delay, abs=1e-4)


def test_no_skew_is_reported_between_unrelated_or_aligned_signals():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 4000))
    assert skew([(a[:, None], b)], 1e-3) is None
    assert skew([(a[:, None], 2.0 * a + 0.1 * b)], 1e-3) is None


def test_late_torque_channel_is_reported(make_logs):
    trajectory = make_logs(joints=1).heldout[0].trajectory
    assert channel_warnings([trajectory]) == []
    assert "LFR +4.0 ms" in channel_warnings([late(trajectory, 4)])[0]


def test_coarse_channel_is_named_with_its_step(make_logs):
    trajectory = make_logs(joints=2).heldout[0].trajectory
    coarse = replace(trajectory, velocity=np.round(trajectory.velocity / 0.3) * 0.3)
    text = " ".join(channel_warnings([coarse]))
    assert "joint/LFR/velocity moves in steps of 0.3 (and 1 more joints)" in text


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_velocity_filter_of_the_plant_is_measured(source):
    trials = [t.trajectory for t in plant_logs(source=source).trials]
    found = lags(trials)
    assert len(found) == 12
    assert [entry.lag_s for entry in found] == pytest.approx([1.0 / (2 * np.pi * 100.0)] * 12, abs=2e-4)  # 100 Hz
    assert not any("velocity" in text for text in channel_warnings(trials))


def test_late_velocity_is_measured_and_warned_about():
    def shifted(t):
        return values("velocity", lambda v: np.stack([np.interp(t.time - 0.0097, t.time, c) for c in v.T], axis=1))(t)

    trials = [shifted(t.trajectory) for t in plant_logs().trials]
    found = lags(trials)
    assert [entry.lag_s for entry in found] == pytest.approx([0.0097 + 0.0016] * 12, abs=2e-4)
    assert all(entry.error_s < 1e-4 for entry in found)
    assert any(
        "velocity against the derivative of the position: later by LFR +11.3 ms" in w for w in channel_warnings(trials)
    )


@pytest.mark.parametrize("kind", ["multisine", "chirp"])
def test_sound_logs_have_no_skew(kind):
    for source in ("pressure", "load_cell"):
        trials = [t.trajectory for t in plant_logs((0, 1), source, kind=kind).trials]
        assert channel_warnings(trials) == []


@pytest.mark.parametrize("name", ["emps", "so101"])
def test_real_logs_have_no_skew(name):
    trials = [t.trajectory for t in real(name).trials]
    assert lags(trials) == []
    assert not any("later by" in text for text in channel_warnings(trials))
