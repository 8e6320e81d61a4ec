"""What the joints of a machine predict of a log, and what the simulator steps of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from position_loop_logs import planted, planted_logs

from hqpipe.gap.fitted_joints import FittedJoints, extrapolated_speed
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import parameter_names
from hqpipe.layers.actuator import Actuator
from hqpipe.machine.layout import neutral_row, slot, slots

EXACT = 1e-7  # N·m, on torques of 400
STEPS = 100
DELAY = slot("command_delay", "delay_s")


@pytest.fixture(scope="module")
def trial():
    late = {"command_delay": planted.TYPICAL["command_delay"]}
    return planted_logs(late, {}, seconds=2.05, noise=0.0).trials[0].trajectory


@pytest.fixture(scope="module")
def right(trial):
    """The numbers of the plant, which moves by the logged speed."""
    rows = np.array([neutral_row(), neutral_row()])
    for name, value in planted.GAINS.items():
        rows[:, slot("base", name)] = value
    rows[0, DELAY] = planted.TYPICAL["command_delay"]["delay_s"]
    return FittedJoints(trial.joints, rows, np.ones(2), np.zeros((2, 2)))


@pytest.mark.parametrize("window", [1, 64, STEPS])
def test_right_numbers_predict_the_log_to_its_last_sample(trial, right, window):
    assert window == 1 or (trial.samples - 1) % window, "the last window is a short one"
    predicted = right.predict(trial, window)
    np.testing.assert_allclose(predicted, trial.effort, atol=EXACT)
    np.testing.assert_array_equal(predicted[0], trial.effort[0])
    np.testing.assert_allclose(right.predict(trial, 2 * trial.samples), trial.effort, atol=1e-4)


def test_a_wrong_number_shows_in_its_joint(trial, right):
    rows = right.rows.copy()
    rows[0, DELAY] = 0.0
    error = np.abs(replace(right, rows=rows).predict(trial, STEPS) - trial.effort).max(axis=0)
    assert error[0] > 20.0 and error[1] < EXACT


def test_joints_are_matched_by_name(trial, right):
    swapped = right.predict(trial.for_joints(trial.joints[::-1]), STEPS)
    np.testing.assert_array_equal(swapped[:, ::-1], right.predict(trial, STEPS))


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_no_prediction_sees_a_later_sample(trial, right, share):
    joints = replace(right, logged_speed=np.full(2, share))
    later = {name: np.concatenate([v[:1234], 2.0 * v[1234:]]) for name, v in trial.channels().items()}
    changed, plain = (joints.predict(t, STEPS) for t in (replace(trial, **later), trial))
    np.testing.assert_array_equal(changed[:1235], plain[:1235])
    assert np.abs(changed[1235:] - plain[1235:]).max() > 1.0


@pytest.mark.parametrize("rows", [2, 5])
def test_a_slower_log_is_predicted_on_the_clock_of_the_model(trial, right, rows):
    slow = thinned(trial, rows)
    predicted = right.predict(slow, STEPS // rows)
    error, moves = (np.sqrt(np.mean((x - slow.effort) ** 2)) for x in (predicted, np.roll(slow.effort, 20, axis=0)))
    assert error < 0.1 * moves
    later = replace(slow, position=np.where(np.arange(slow.samples)[:, None] > 100, 2.0, 1.0) * slow.position)
    np.testing.assert_array_equal(right.predict(later, STEPS // rows)[:102], predicted[:102])


def thinned(trial, rows):
    """One row of so many."""
    return replace(trial, time=trial.time[::rows], **{name: v[::rows] for name, v in trial.channels().items()})


def test_speed_is_continued_as_it_changed():
    speed = np.arange(50.0)
    np.testing.assert_allclose(extrapolated_speed(np.cumsum(speed), 1.0)[3:-1], speed[4:], atol=1e-9)


def test_joints_share_one_flow():
    """What two joints find of the openings' part in it is averaged; one that feels no supply says nothing of it."""
    models = Actuator().joints(planted_logs({}, {}, {}, seconds=2.0), STEPS * planted.DT).models
    values = []
    for model, (droop, share) in zip(models, [(0.1, 0.4), (0.1, 0.6), (0.0, 1.0)], strict=True):
        names = parameter_names(model)
        values.append(Fitter(model).neutral)
        values[-1][names.index(("supply_droop", "droop"))] = droop
        values[-1][names.index(("supply_droop", "by_opening"))] = share
    rows = FittedJoints.of(models, values).rows
    draws = np.array([model.draws for model in models])
    flow = rows[:, [slot("setting", "flow_per_speed"), slot("setting", "flow_per_opening")]]
    np.testing.assert_allclose(flow, 0.5 * draws)


def test_the_simulator_steps_no_sensor(right):
    rows, bias = right.rows.copy(), slots("torque_bias")[0]
    rows[1, bias] = 30.0
    actuator = replace(right, rows=rows).actuator()
    np.testing.assert_array_equal(actuator.parameters, right.rows)
    assert actuator.joints == right.joints and actuator.dt == rows[0, slot("setting", "sample_time")]
