"""Predictions and residuals of whole trials."""

from __future__ import annotations

import numpy as np
import pytest
from small_logs import log_set, trajectory

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import IdentificationError, UsageError
from hqpipe.sysid.baselines import CommandedTorque, MeanTorque, Persistence, fit_stiff_pd
from hqpipe.sysid.free_run import free_run, predict

HYDRAULIC = {"k1": [500.0, 700.0], "k2": 0.05, "k3": 20.0, "k4": 0.0, "sprocket_radius": 1.0}


def hydraulic(joints=("hip", "knee"), dt=1e-3):
    return Hydraulic.build(joints, dt=dt, effort_limit=np.inf, **HYDRAULIC)


def test_prediction_starts_from_the_log_and_matches_joints_by_name():
    trial = trajectory()
    predicted = free_run(trial, hydraulic(), 0.1)
    np.testing.assert_array_equal(predicted[0], trial.effort[0])
    swapped = free_run(trial.for_joints(("knee", "hip")), hydraulic(), 0.1)
    np.testing.assert_array_equal(swapped[:, ::-1], predicted)


def test_first_sample_of_a_window_is_one_step_and_the_last_a_window_ahead():
    trial = trajectory()
    long, short = free_run(trial, hydraulic(), 0.1), predict(trial, hydraulic(), 1)
    np.testing.assert_array_equal(long[1::100], short[1::100])
    assert not np.allclose(long[100], short[100])


def test_another_rate_is_refused():
    with pytest.raises(UsageError, match="cannot be stepped at 0.002 s"):
        free_run(trajectory(dt=2e-3), hydraulic())
    free_run(trajectory(dt=2e-3), StiffPD.build(("hip", "knee"), kp=1.0, kd=0.0, effort_limit=np.inf))


def test_a_window_needs_two_samples():
    with pytest.raises(IdentificationError, match="holds 1 samples at 1000 Hz.*0.004 s or more"):
        free_run(trajectory(), hydraulic(), 1e-3)


def test_missing_channels_are_named():
    with pytest.raises(IdentificationError, match=r"joint/<name>/position_command, which the logs lack"):
        free_run(trajectory(position_command=None), hydraulic())


def test_persistence_holds_the_torque_of_the_window_start():
    trial = trajectory(samples=7)
    held = Persistence().predict(trial, 3)
    np.testing.assert_array_equal(held, trial.effort[[0, 0, 0, 0, 3, 3, 3]])
    np.testing.assert_array_equal(Persistence().predict(trial, 1)[1:], trial.effort[:-1])


def test_mean_and_commanded_torque():
    trial = trajectory(effort_command=np.arange(1200.0).reshape(600, 2))
    logs = log_set(trial, trajectory(seed=1))
    mean = MeanTorque.of(logs.fit).predict(trial.for_joints(("knee", "hip")), 1)
    np.testing.assert_allclose(mean[1], trial.effort.mean(axis=0)[::-1])
    np.testing.assert_array_equal(CommandedTorque().predict(trial, 100)[1:], trial.effort_command[:-1])


def test_static_gains_are_recovered():
    trial = trajectory()
    truth = StiffPD.build(("hip", "knee"), kp=[6000.0, 3000.0], kd=[200.0, 0.0], effort_limit=np.inf)
    driven = trajectory(effort=free_run(trial, truth))
    fitted = fit_stiff_pd(log_set(driven, driven).fit, np.full(2, np.inf))
    np.testing.assert_allclose(fitted.column("kp"), truth.column("kp"), rtol=1e-6)
    np.testing.assert_allclose(fitted.column("kd"), truth.column("kd"), atol=0.05)
