"""Channels against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.gap.replay import replay
from hqpipe.gap.sensing import channel_warnings, model_warnings, skew


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


def test_late_torque_channel_is_reported_by_both_checks(make_logs, right_model):
    logs = make_logs(joints=1)
    trial = logs.heldout[0]
    model = right_model(logs)
    assert channel_warnings([trial.trajectory]) == []
    assert model_warnings([replay(trial, model, 0.1)]) == []
    shifted = replace(trial, trajectory=late(trial.trajectory, 4))
    assert "LFR +3.5 ms" in channel_warnings([shifted.trajectory])[0]
    assert "command delay or a skewed channel" in model_warnings([replay(shifted, model, 0.1)])[0]


def test_coarse_channel_is_named_with_its_step(make_logs):
    trajectory = make_logs(joints=2).heldout[0].trajectory
    coarse = replace(trajectory, velocity=np.round(trajectory.velocity / 0.3) * 0.3)
    text = " ".join(channel_warnings([coarse]))
    assert "joint/LFR/velocity moves in steps of 0.3 (and 1 more joints)" in text
