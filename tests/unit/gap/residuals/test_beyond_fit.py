"""Held-out trials that go beyond the fit trials are told, with the share of the error that lies there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layer_cases import WINDOW_S, layer_found, log_set, made_up, toy

from hqpipe.gap.residuals.beyond_fit import beyond_fit
from hqpipe.gap.residuals.layer_errors import layer_errors


def told(joints, logs):
    return beyond_fit(logs, layer_errors(layer_found(*joints), logs).joints, WINDOW_S)


def joint_with(model, error):
    """The joint with these errors (N,) at the held-out samples."""
    found = made_up(model, base=2.0, named=1.0)
    return replace(found, named=replace(found.named, heldout=error))


def faster(model, factor, rows):
    """The joint that moves `factor` times as fast in some of its held-out samples."""
    velocity = model.heldout.velocity.copy()
    velocity[rows] *= factor
    model.heldout = replace(model.heldout, velocity=velocity)
    return model


@pytest.fixture
def fast():
    """One joint that is four times as fast in the second half of its held-out trial."""
    model = toy("knee", 1)
    count = len(model.heldout.time)
    rows = np.arange(count) >= count // 2
    return faster(model, 4.0, rows), rows


def test_an_error_beyond_the_speeds_of_the_fit_trials_is_told(fast):
    model, rows = fast
    found = joint_with(model, np.where(rows, 5.0, 0.1))
    (line,) = told([found], log_set([model]))
    assert line.file == model.heldout.files[0]
    assert "speed" in line.text and "knee" in line.text and "% of the error" in line.text
    assert float(line.text.split("%")[0].split()[-1]) >= 90


def test_an_error_within_the_fit_trials_is_not(fast):
    model, rows = fast
    assert not told([joint_with(model, np.where(rows, 0.1, 5.0))], log_set([model]))


def test_a_motion_as_in_the_fit_trials_is_not():
    model = toy("knee", 1)
    assert not told([joint_with(model, np.full(len(model.heldout.time), 5.0))], log_set([model]))


def test_joints_that_are_fast_together_are_told():
    models = [toy("hip", 1), toy("knee", 2)]
    logs = log_set(models)
    trials = [
        replace(
            t, trajectory=replace(t.trajectory, velocity=(3.0 if t.split == "heldout" else 1.0) * t.trajectory.velocity)
        )
        for t in logs.trials
    ]
    found = [joint_with(model, np.full(len(model.heldout.time), 5.0)) for model in models]
    (line,) = told(found, replace(logs, trials=tuple(trials)))
    assert "all joints together" in line.text
