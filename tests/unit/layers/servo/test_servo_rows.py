"""Rows that come much faster than a joint responds, and windows where the logs hold more than are simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from servo_plant import Truth, fit, log_set

from hqpipe.layers.servo import Servo
from hqpipe.layers.servo.rows import FINE, rows_of_step, thinned

SLOW = Truth(inertia=0.2, kp=40.0, kd=16.0, gravity=0.5, friction=0.8, delay=0.03)


@pytest.fixture(scope="module")
def fast():
    """A servo that takes 0.2 s to follow, logged at 500 Hz."""
    return log_set(SLOW, seconds=8.0, hz=500.0)


def test_a_step_is_a_part_of_the_response_time_and_of_the_window():
    assert rows_of_step(1e-3, FINE * 1e-2, None) == 10
    assert rows_of_step(1e-3, FINE * 0.9e-3, None) == 1
    assert rows_of_step(1e-3, FINE * 1e-2, 0.04) == 4


def test_what_inputs_did_between_two_rows_counts(fast):
    t = fast.trials[0].trajectory
    rows = np.arange(t.samples, dtype=np.float64)[:, None]
    extra = {"supply/voltage": rows[:, 0], "temperature": rows[:, 0]}
    trial = replace(
        fast.trials[0],
        trajectory=replace(t, position=rows, position_command=rows, duty=rows, extra=extra),
    )
    thin = thinned(trial, "j", 4).trajectory
    assert thin.dt == pytest.approx(8e-3)
    assert thin.samples == t.samples // 4
    assert np.array_equal(thin.position, rows[::4][: thin.samples])
    assert np.array_equal(thin.extra["temperature"], thin.position[:, 0])
    assert np.allclose(thin.position_command, thin.position + 1.5)  # held from its row on
    for measured in (thin.duty[:, 0], thin.extra["supply/voltage"]):
        assert np.allclose(measured[1:], thin.position[1:, 0])  # about its row


def test_a_slow_joint_is_known_as_well_from_a_fast_log(fast):
    joint = Servo().joints(fast).models[0]
    response = 0.5 * joint.setting.slow_s
    assert joint.dt <= response / FINE < joint.dt + 1.0 / 500.0
    assert joint.setting.substeps == 1
    slow = Servo().joints(log_set(SLOW, seconds=8.0, hz=1.0 / joint.dt)).models[0]
    assert len(joint.splits[0].windows.start) == pytest.approx(len(slow.splits[0].windows.start), abs=1)
    found = fit(joint, ("coulomb_friction", "command_delay"))
    assert found["drag"] == pytest.approx(16.0 / 40.0, rel=0.03)
    assert found["coulomb_friction.friction_nm"] == pytest.approx(0.8 / 40.0, rel=0.05)
    assert found["command_delay.delay_s"] == pytest.approx(0.03, abs=2e-3)


def test_a_window_that_was_asked_for_is_kept(fast):
    found = Servo().joints(fast, window_s=0.04)
    assert found.window_s == pytest.approx(0.04)
    assert found.models[0].dt == pytest.approx(0.004)


def test_of_a_log_at_rest_half_of_the_windows_are_those_in_motion():
    """A joint that moves for 8 s of 200."""
    logs = log_set(Truth(friction=0.5), seconds=8.0)
    trials = []
    for trial in logs.trials:
        t = trial.trajectory
        rest = np.full((5 * 7680, 1), 1.0)
        columns = {
            name: np.vstack([values, values[-1] * rest]) if name != "velocity" else np.vstack([values, 0.0 * rest])
            for name, values in t.channels().items()
        }
        time = 0.005 * np.arange(len(columns["position"]))
        trials.append(replace(trial, trajectory=replace(t, time=time, **columns)))
    joint = Servo().joints(replace(logs, trials=tuple(trials))).models[0]
    starts = joint.splits[0].windows.start
    end = len(logs.trials[0].trajectory.time)
    every = end // (joint.setting.samples)
    assert np.count_nonzero(starts < end) >= every - 2  # all of them, but for what the run-in takes
    assert np.count_nonzero(starts >= end) >= every
