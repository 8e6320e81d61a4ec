"""Replays of a machine from its rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, TYPICAL, logs_of, planted, size

from hqpipe.effects.layout import neutral_row, slot
from hqpipe.gap.joint_data import CONTINUED, continued
from hqpipe.gap.row_model import RowModel, SpanRow, driven, kept, replay_all

EXACT = 1e-7  # N·m, on torques of 400


def row(**effects):
    p = neutral_row()
    for name, value in planted.GAINS.items():
        p[slot("base", name)] = value
    for name in effects:
        p[slot(name, "delay_s")] = TYPICAL[name]["delay_s"]
    return p


@pytest.fixture(scope="module")
def logs():
    return logs_of([size("command_delay"), {}], seconds=2.05, noise=0.0)


@pytest.fixture(scope="module")
def model(logs):
    return RowModel(logs.joints, np.array([row(command_delay=1), row()]), "position")


def test_right_rows_predict_the_log(logs, model):
    item = model.replay(logs.trials[0], STEPS)
    used = item.windows * STEPS
    assert item.windows == 20
    np.testing.assert_allclose(item.predicted[: used + 1], logs.trials[0].trajectory.effort[: used + 1], atol=EXACT)
    np.testing.assert_allclose(item.one_step, logs.trials[0].trajectory.effort, atol=EXACT)


def test_wrong_row_is_off_in_its_joint(logs, model):
    wrong = replace(model, rows=np.array([row(), row()]))
    error = np.abs(wrong.replay(logs.trials[0], STEPS).residual).max(axis=0)
    assert error[0] > 20.0 and error[1] < EXACT


def test_other_row_in_a_stretch(logs, model):
    stretch = SpanRow(row(command_delay=1), {logs.trials[0].file: (0.5, 1.0)})
    partly = replace(model, rows=np.array([row(), row()]), spans={0: stretch})
    plain = replace(model, rows=np.array([row(), row()]))
    mixed, right, wrong = (m.replay(logs.trials[0], STEPS).predicted[:, 0] for m in (partly, model, plain))
    np.testing.assert_array_equal(mixed[501:1001], right[501:1001])
    np.testing.assert_array_equal(mixed[:501], wrong[:501])
    np.testing.assert_array_equal(mixed[1001:], wrong[1001:])
    other = partly.replay(logs.trials[1], STEPS).predicted[:, 0]
    np.testing.assert_array_equal(other, plain.replay(logs.trials[1], STEPS).predicted[:, 0])


def test_memory_is_what_is_left_of_an_offset(model):
    np.testing.assert_allclose(model.memory, 0.95)
    np.testing.assert_allclose(kept(model, 3)[:, 0], [0.95, 0.95**2, 0.95**3])
    torque = replace(model, mode="torque", rows=neutral_row()[None])
    torque.rows[0, slot("base", "k1")] = 0.3
    np.testing.assert_allclose(torque.memory, 0.7)


def test_the_drive_of_torque_mode_is_the_error_of_the_torque_of_the_model(logs):
    t = logs.trials[0].trajectory
    t = replace(t, effort_command=t.effort + 7.0)
    assert driven(t, t.effort, "position") is t
    drive = driven(t, t.effort - 2.0, "torque")
    np.testing.assert_allclose(drive.position_command - drive.position, 9.0)


def test_trials_without_a_window_are_left_out(logs, model):
    short = replace(logs.trials[0], trajectory=logs.trials[0].trajectory.section(0, STEPS))
    assert replay_all(model, [short, logs.trials[1]], STEPS)[0].file == logs.trials[1].file
    assert len(replay_all(model, [short], STEPS)) == 0


def test_prediction_goes_to_the_last_sample_of_the_trial(logs, model):
    """Windows that do not fit in: the last one is shorter, and as right as the others."""
    trial = logs.trials[0].trajectory
    assert (trial.samples - 1) % 64
    np.testing.assert_allclose(model.predict(trial, 64), trial.effort, atol=EXACT)
    np.testing.assert_allclose(model.predict(trial, 2 * trial.samples), trial.effort, atol=1e-4)
    np.testing.assert_array_equal(
        model.predict(trial, STEPS)[1:2001], model.replay(logs.trials[0], STEPS).predicted[1:2001]
    )


def test_a_speed_that_is_continued_sees_no_later_sample(logs, model):
    trial, known = logs.trials[0].trajectory, replace(model, speed=CONTINUED)
    predicted = known.predict(trial, STEPS)
    later = {name: np.concatenate([v[:1234], 2.0 * v[1234:]]) for name, v in trial.channels().items()}
    np.testing.assert_array_equal(known.predict(replace(trial, **later), STEPS)[:1235], predicted[:1235])
    assert np.abs(model.predict(replace(trial, **later), STEPS)[:1235] - model.predict(trial, STEPS)[:1235]).max() > 1.0
    speed = np.arange(50.0)
    np.testing.assert_allclose(continued(np.cumsum(speed), 1.0)[3:-1], speed[4:], atol=1e-9)
