"""Predictions and residuals of whole trials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from actuators.net_examples import random_net
from identify.small_logs import log_set, trajectory
from machine.augmented_rows import planted, row

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.errors import IdentificationError, UsageError
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.identify.free_run import free_run, predict
from hqpipe.identify.rivals.baselines import CommandedTorque, MeanTorque, Persistence, fit_stiff_pd
from hqpipe.machine.layout import slot

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
    with pytest.raises(UsageError, match="cannot be stepped at 0.0014 s"):
        free_run(trajectory(dt=1.4e-3), hydraulic())
    free_run(trajectory(dt=1.4e-3), StiffPD.build(("hip", "knee"), kp=1.0, kd=0.0, effort_limit=np.inf))


def test_a_slower_log_is_replayed_on_the_clock_of_the_model():
    """Where nothing moves, and the command stays, the rows of a slow log are every fifth of a fast one."""
    fast = trajectory(samples=1001)
    still = replace(fast, position=np.zeros_like(fast.position), velocity=np.zeros_like(fast.velocity))
    still = replace(still, position_command=np.full_like(still.position, 0.02))
    slow = replace(still, time=still.time[::5], **{name: v[::5] for name, v in still.channels().items()})
    np.testing.assert_allclose(free_run(slow, hydraulic(), 0.1), free_run(still, hydraulic(), 0.1)[::5], atol=1e-9)


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


NETS = [("mlp", {"taps": (0, 4, 9), "delta": True}), ("lstm", {}), ("gru", {"delta": True}), ("mlp", {})]


@pytest.mark.parametrize(("kind", "options"), NETS)
def test_a_net_remembers_the_log_before_the_window(kind, options):
    """By hand: a copy that the log drives all along, and a copy of it that runs free for a window."""
    trial = trajectory(samples=61)
    model = random_net(kind, trial.joints, **options)
    expected, memory = trial.effort.copy(), model.fresh_memory(1)

    def step(torque, remembered, k):
        inputs = (a[k : k + 1] for a in (trial.position_command, trial.position, trial.velocity))
        model.step(torque, remembered, *inputs, dt=1e-3)
        return torque[0]

    for k in range(60):
        if k % 20 == 0:
            free, torque = memory.copy(), trial.effort[k : k + 1].copy()
        expected[k + 1] = step(torque, free, k)
        step(trial.effort[k : k + 1].copy(), memory, k)
    np.testing.assert_array_equal(predict(trial, model, 20), expected)
    one = predict(trial, model, 1)
    np.testing.assert_array_equal(one[1::20], expected[1::20])
    if model.memory_columns:
        late = predict(trial.section(20, 61), model, 20)
        assert not np.allclose(late[1:], expected[21:]), "without the log before it, the window comes out differently"


def test_a_net_matches_joints_by_name():
    trial = trajectory()
    model = random_net("gru", ("knee", "hip"))
    swapped = predict(trial.for_joints(("knee", "hip")), model, 100)
    np.testing.assert_allclose(swapped[:, ::-1], predict(trial, model, 100), rtol=1e-6, atol=2e-4)  # single precision


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize(
    "effects",
    [("valve_lag", "orifice_flow"), ("command_delay", "supply_droop"), ("coulomb_friction", "valve_deadband")],
)
def test_augmented_replays_as_the_diagnosis_does(effects, noise):
    """Against the windows that a fit goes through, with a model that is off, so that the log has to set it right."""
    values = {name: planted.TYPICAL[name] for name in effects}
    trial = planted.trajectory(planted.simulate(1.5, [values] * 2, noise, 6))
    rows = np.tile(row(values), (2, 1))
    rows[:, slot("base", "k1")] *= 0.9
    windows = FittedJoints(trial.joints, rows, np.ones(2), np.zeros((2, 2))).predict(trial, 100)
    found = predict(trial, Augmented(trial.joints, rows, 1e-3), 100)
    np.testing.assert_allclose(found, windows, rtol=1e-9, atol=1e-8)
    assert np.abs(found - trial.effort).max() > 5.0


@pytest.mark.parametrize("effect", ["backlash", "channel_skew", "torque_bias"])
def test_what_samples_cannot_replay_is_refused(effect):
    rows = np.stack([row({}), row({effect: planted.TYPICAL[effect]})])
    with pytest.raises(UsageError, match=f"{effect} of knee cannot be replayed sample by sample"):
        predict(trajectory(), Augmented(("hip", "knee"), rows, 1e-3), 100)
