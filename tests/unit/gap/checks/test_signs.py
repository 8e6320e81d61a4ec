"""Torque that lost its sign gets it back before anything is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, values
from planted_logs import logs_of

from hqpipe.gap.checks.signs import restore_efforts


@pytest.fixture(scope="module")
def logs():
    return logs_of([{}, {}], seconds=4.0)


@pytest.fixture(scope="module")
def lost(logs):
    return broken(logs, values("effort", np.abs, 1))


def test_lost_sign_is_restored_in_its_joint_only(logs, lost):
    signed = restore_efforts(lost)
    assert signed.joints == (logs.joints[1],)
    for old, new, given in zip(logs.trials, signed.log_set.trials, lost.trials, strict=True):
        true, restored = old.trajectory.effort, new.trajectory.effort
        np.testing.assert_array_equal(restored[:, 0], true[:, 0])
        np.testing.assert_array_equal(np.abs(restored), np.abs(given.trajectory.effort[:, [0, 1]]) * [1, 1])
        wrong = np.abs(true[:, 1])[np.sign(true[:, 1]) != np.sign(restored[:, 1])].sum()
        assert wrong < 0.01 * np.abs(true[:, 1]).sum()


def test_sound_logs_are_handed_on(logs):
    signed = restore_efforts(logs)
    assert signed.log_set is logs and signed.joints == ()


def test_it_is_an_effect_of_the_library_and_of_position_mode(lost):
    assert restore_efforts(lost, ["unsigned_sensor"]).log_set is lost
    other = replace(lost, control_mode="torque")
    assert restore_efforts(other).log_set is other


def test_given_logs_are_not_changed(lost):
    before = [t.trajectory.effort.copy() for t in lost.trials]
    restore_efforts(lost)
    for trial, effort in zip(lost.trials, before, strict=True):
        np.testing.assert_array_equal(trial.trajectory.effort, effort)


def test_trials_of_other_rates_get_their_signs_by_models_of_their_own():
    """One model of a step cannot be that of a step twice as long."""
    logs = logs_of([{}, {}], seconds=8.0)
    slow = [i for i in range(len(logs.trials)) if i % 2]

    def halved(t):
        return replace(t, time=t.time[::10], **{name: v[::10] for name, v in t.channels().items()})

    mixed = broken(broken(logs, halved, slow), lambda t: t)
    signed = restore_efforts(broken(mixed, values("effort", np.abs, 0)))
    assert signed.joints == (logs.joints[0],)
    for true, found in zip(mixed.trials, signed.log_set.trials, strict=True):
        a, b = true.trajectory.effort[:, 0], found.trajectory.effort[:, 0]
        assert np.abs(a)[np.sign(a) != np.sign(b)].sum() < 0.1 * np.abs(a).sum(), found.file
