"""The base law of a control mode, fitted to one joint in windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, logs_of

from hqpipe.gap.checks.base_fit import MOST_WINDOWS, BaseFit

NOISE = 3.0
K1, K2, K3 = 0.12, 0.02, 4.0


@pytest.fixture(scope="module")
def trials():
    return [trial.trajectory for trial in logs_of([{}, {}], seconds=3.0, noise=NOISE, fit=2).trials]


@pytest.fixture(scope="module")
def by_torque(trials):
    """The same motion under a torque loop, whose command is held for 20 ms."""
    found = []
    for n, t in enumerate(trials):
        rng = np.random.default_rng(n)
        command = np.repeat(rng.normal(0.0, 200.0, (t.samples // 20 + 1, 2)), 20, axis=0)[: t.samples]
        torque = np.zeros((t.samples, 2))
        for k in range(t.samples - 1):
            torque[k + 1] = torque[k] + K1 * (command[k] - torque[k]) - K2 * torque[k] - K3 * t.velocity[k]
        noisy = torque + rng.normal(0.0, NOISE, torque.shape)
        found.append(replace(t, effort=noisy, effort_command=command, position_command=None))
    return found


def rms(errors):
    return np.sqrt(np.mean(errors))


def test_the_right_law_leaves_the_noise_in_both_modes(trials, by_torque):
    for logs, mode in ((trials, "position"), (by_torque, "torque")):
        fit = BaseFit.of(logs, 1, mode, STEPS, logged_speed=True)
        assert len(fit.errors()) == len(fit.first) == 3 * 29
        assert NOISE < rms(fit.errors()) < 1.2 * NOISE


def test_windows_know_their_place(trials):
    fit = BaseFit.of(trials, 0, "position", STEPS, logged_speed=False)
    for number, trial in enumerate(trials):
        mine = fit.windows.trial == number
        np.testing.assert_array_equal(fit.first[mine], np.arange(0, trial.samples - STEPS, STEPS))
        begin = fit.windows.bounds[mine, 0]
        np.testing.assert_array_equal(fit.data.effort[begin], trial.effort[fit.first[mine], 0])
    assert len(BaseFit.of(trials, 0, "position", 10, logged_speed=False).first) == MOST_WINDOWS


def test_a_law_that_other_windows_set_shows_those_that_differ(trials):
    """The torque of one trial is half as large: fitted to the others, the law errs there and nowhere else."""
    odd = [replace(t, effort=0.5 * t.effort) if n == 1 else t for n, t in enumerate(trials)]
    fit = BaseFit.of(odd, 0, "position", STEPS, logged_speed=False)
    inside = fit.windows.trial == 1
    errors = fit.errors(~inside)
    assert rms(errors[~inside]) < 1.2 * NOISE and rms(errors[inside]) > 10.0 * NOISE
    assert rms(fit.errors()[~inside]) > 2.0 * rms(errors[~inside])


def test_the_speed_is_the_logged_one_where_that_is_asked_for(trials):
    late = [replace(t, velocity=np.roll(t.velocity, 20, axis=0)) for t in trials]
    logged, moved = (rms(BaseFit.of(late, 0, "position", STEPS, logged_speed=b).errors()) for b in (True, False))
    assert moved < 1.2 * NOISE < logged


def test_what_was_not_recorded_counts_for_nothing(trials):
    t = trials[0]
    observed = np.ones(t.effort.shape, dtype=bool)
    observed[np.r_[310:330, 600, 777]] = False
    holes = replace(t, observed=observed)
    wild = replace(holes, effort=np.where(observed, t.effort, 1e7))
    fits = [BaseFit.of([each], 0, "position", STEPS, logged_speed=False) for each in (holes, wild)]
    assert 600 not in fits[0].first
    assert rms(fits[1].errors()) == pytest.approx(rms(fits[0].errors()), rel=1e-3)


def test_a_trial_that_holds_no_window_leaves_no_errors(trials):
    fit = BaseFit.of([trials[0].section(0, STEPS)], 0, "position", STEPS, logged_speed=False)
    assert len(fit.errors()) == 0
