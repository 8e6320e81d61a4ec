"""The paper's model with effects that the fit trials alone have shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, logs_of, size

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.gap.diagnosed import fit_diagnosed
from hqpipe.gap.fitted_joints import FittedJoints
from hqpipe.identify.identify import identify
from hqpipe.layers.actuator import Actuator
from hqpipe.logs.split import hold_back
from hqpipe.machine import EFFECTS
from hqpipe.machine.layout import neutral_row, slot, slots

KEPT = ("command_delay", "valve_deadband", "backlash", "torque_bias")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)
NOISE = 3.0
LATE_ROWS = 2
BIAS = slots("torque_bias")[0]


@pytest.fixture(scope="module")
def logs():
    return logs_of([size("command_delay", "torque_bias"), size("backlash"), {}], seconds=9.0, noise=NOISE, seed=2)


@pytest.fixture(scope="module")
def found(logs):
    return fit_diagnosed(logs, without=WITHOUT)


def error(model, trial, window=STEPS):
    return np.sqrt(np.mean((model.predict(trial, window) - trial.effort)[1:] ** 2, axis=0))


def test_planted_effects_are_found_and_predict_what_was_never_fitted(logs, found):
    first, second, _ = logs.joints
    assert found.effects == {"command_delay": (first,), "backlash": (second,), "torque_bias": (first,)}
    held = logs.heldout[0].trajectory
    assert (error(found, held) < 1.3 * NOISE).all()
    assert (error(found, held, 1) < 1.7 * NOISE).all(), "noise counts at the sample and where the step starts"


def test_held_out_trials_have_no_say(logs, found):
    rng = np.random.default_rng(0)
    noise = [
        replace(t, trajectory=replace(t.trajectory, effort=rng.normal(size=t.trajectory.effort.shape)))
        for t in logs.heldout
    ]
    other = fit_diagnosed(replace(logs, trials=(*logs.fit, *noise)), without=WITHOUT)
    np.testing.assert_array_equal(other.rows.rows, found.rows.rows)
    alone = fit_diagnosed(replace(logs, trials=tuple(logs.fit)), without=WITHOUT)
    np.testing.assert_array_equal(alone.rows.rows, found.rows.rows)


def test_the_whole_of_the_fit_trials_sets_the_numbers(logs, found):
    chosen = identify(Actuator().joints(hold_back(logs), 0.1, WITHOUT)).found
    before = FittedJoints.of([joint.model for joint in chosen], [joint.named.values for joint in chosen])
    delay = slot("command_delay", "delay_s")
    first, again = (model.rows[0, delay] for model in (before, found.rows))
    assert 0.0 < abs(first - again) < 0.2 * first
    whole = logs.fit[0].trajectory
    assert (error(found.rows, whole) < error(before, whole)).all()


def test_a_speed_that_was_filtered_is_replaced_by_what_the_positions_say(logs, found):
    """The logged one is kept where it is right: what two steps make expect of the next is noisier."""
    assert (found.rows.logged_speed > 0.9).all()
    late = tuple(
        replace(t, trajectory=replace(t.trajectory, velocity=np.roll(t.trajectory.velocity, LATE_ROWS, axis=0)))
        for t in logs.trials
    )
    other = fit_diagnosed(replace(logs, trials=late), without=WITHOUT)
    assert (other.rows.logged_speed < 0.1).all() and other.effects == found.effects
    assert (error(other, late[1].trajectory) < 2.0 * NOISE).all()
    logged = replace(other.rows, logged_speed=np.ones(len(logs.joints)))
    assert (error(logged, late[1].trajectory) > 2.0 * NOISE).any()


def test_the_simulator_gets_all_but_the_sensors(found):
    assert found.rows.rows[0, BIAS] != 0.0
    neutral = neutral_row()
    np.testing.assert_array_equal(found.actuator.parameters[:, BIAS], neutral[BIAS])
    same = np.arange(len(neutral)) != BIAS
    np.testing.assert_array_equal(found.actuator.parameters[:, same], found.rows.rows[:, same])


def test_joints_are_matched_by_name_and_other_rates_refused(logs, found):
    trial = logs.heldout[0].trajectory
    swapped = found.predict(trial.for_joints(logs.joints[::-1]), STEPS)
    np.testing.assert_array_equal(swapped[:, ::-1], found.predict(trial, STEPS))
    with pytest.raises(UsageError, match="cannot be stepped at 0.0014 s"):
        found.predict(replace(trial, time=1.4 * trial.time), STEPS)
    with pytest.raises(IdentificationError, match="position_command, which the logs lack"):
        found.predict(replace(trial, position_command=None), STEPS)


def test_a_supply_that_joints_share_sags_by_the_flow_of_all():
    sagging = logs_of([size("supply_droop")] * 3, seconds=9.0, noise=NOISE)
    found = fit_diagnosed(sagging, without=[name for name in EFFECTS if name != "supply_droop"])
    assert found.effects == {"supply_droop": sagging.joints}
    assert (error(found, sagging.heldout[0].trajectory) < 1.3 * NOISE).all()


def test_an_effect_of_some_time_is_told_and_left_out():
    plain = logs_of([{}, {}], seconds=24.0, noise=NOISE, seed=4)

    def offset(t):
        effort = t.effort.copy()
        late = (t.time >= 5.0) & (t.time < 10.0) | (t.time >= 18.5) & (t.time < 21.0)
        effort[late, 0] += 60.0
        return replace(t, effort=effort)

    passing = replace(plain, trials=tuple(replace(x, trajectory=offset(x.trajectory)) for x in plain.trials))
    found = fit_diagnosed(passing, without=WITHOUT)
    (told,) = found.warnings
    assert told == f"torque_bias in {plain.joints[0]} acts for a part of the fit trials only and is left out"
    assert found.effects == {} and found.rows.rows[0, BIAS] == 0.0


def test_what_cannot_be_done_says_why(logs):
    with pytest.raises(IdentificationError, match="control mode is torque"):
        fit_diagnosed(replace(logs, control_mode="torque"))
    (trial,) = logs.fit
    short = replace(trial, trajectory=trial.trajectory.section(0, 300))
    with pytest.raises(IdentificationError, match="record longer ones"):
        fit_diagnosed(replace(logs, trials=(short, *logs.heldout)))
    short = replace(trial, trajectory=trial.trajectory.section(0, 3000))
    with pytest.raises(IdentificationError, match="9 windows of 0.1 s, expected at least 20"):
        fit_diagnosed(replace(logs, trials=(short, *logs.heldout)))
    size_only = replace(trial, trajectory=replace(trial.trajectory, effort=np.abs(trial.trajectory.effort)))
    with pytest.raises(IdentificationError, match="has lost its sign"):
        fit_diagnosed(replace(logs, trials=(size_only, *logs.heldout)))
    command = trial.trajectory.position_command.copy()
    command[:, 2] = trial.trajectory.position[:, 2]
    followed = replace(trial, trajectory=replace(trial.trajectory, position_command=command))
    with pytest.raises(IdentificationError, match="LFK: its commanded position is its position in every sample"):
        fit_diagnosed(replace(logs, trials=(followed, *logs.heldout)))
