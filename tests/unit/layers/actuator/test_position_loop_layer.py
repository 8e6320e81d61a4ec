"""Which joints and which samples the layer judges: masks, sections, thinning, joints at rest, what the logs must hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from position_loop_logs import DT, changed, neutral, planted, planted_logs, swinging, with_column

from hqpipe.errors import IdentificationError
from hqpipe.identify.identify import identify
from hqpipe.identify.model import parameter_names
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.record import MOST_SAMPLES, record_of
from hqpipe.layers.actuator.sizes import sizes_of
from hqpipe.layers.actuator.window_runs import FEWEST_RUNS, LEAD, MOST_WINDOWS, window_runs
from hqpipe.logs.trajectory import Excerpt, Trial


def test_offsets_of_torque_and_position_are_one_term_and_never_in_one_set(logs):
    effects = {effect.name: effect for effect in Actuator().joints(logs).models[0].effects}
    assert effects["position_bias"].excludes == {"torque_bias"} and effects["torque_bias"].excludes == {"position_bias"}
    alone = {effect.name: effect for effect in Actuator().joints(logs, without=["torque_bias"]).models[0].effects}
    assert not alone["position_bias"].excludes


def test_windows_that_touch_an_end_stop_are_not_judged(logs):
    def stopped(t):
        touched = (t.position[:, 0] > np.quantile(t.position[:, 0], 0.8)).astype(float)
        return replace(t, extra={f"joint/{t.joints[0]}/at_end_stop": touched})

    marked = changed(logs, stopped)
    first, second = Actuator().joints(marked).models
    free = Actuator().joints(logs).models
    record, t = first.records[0], marked.fit[0].trajectory
    touched = t.extra[f"joint/{t.joints[0]}/at_end_stop"] > 0.5
    within = record.signals.first[:, None] + np.arange(record.signals.steps + 1)
    assert not touched[within].any() and 10 <= record.windows < free[0].records[0].windows
    assert second.records[0].windows == free[1].records[0].windows  # the mark is of one joint


def test_what_is_logged_at_an_end_stop_counts_for_nothing(logs):
    """Any other torque there gives the same sizes, windows and errors."""

    def stopped(t):
        touched = t.position[:, 0] > np.quantile(t.position[:, 0], 0.8)
        return replace(t, extra={f"joint/{t.joints[0]}/at_end_stop": touched.astype(float)})

    def other(t):
        touched = t.extra[f"joint/{t.joints[0]}/at_end_stop"] > 0.5
        return replace(t, effort=np.where(touched[:, None], [1e6, 0.0], t.effort))

    marked = changed(logs, stopped)
    sizes = [sizes_of([t.trajectory for t in x.fit], 0, np.ones(2)) for x in (marked, changed(marked, other))]
    assert sizes[0].of == sizes[1].of and sizes[0].most_effort == sizes[1].most_effort < 1e6
    one, two = (Actuator().joints(x).models[0] for x in (marked, changed(marked, other)))
    values = neutral(one)
    assert np.array_equal(one.fit.output, two.fit.output)
    assert np.array_equal(one.error(values), two.error(values))


def test_the_curve_of_a_slow_joint_s_friction_may_be_as_wide_as_that_of_the_middle_joint(logs):
    trials = [t.trajectory for t in logs.fit]
    slower = [replace(t, velocity=t.velocity * np.array([0.1, 1.0])) for t in trials]
    alone, beside, other = (
        sizes_of(slower, j, np.ones(2), alike=alike) for j, alike in ((0, ()), (0, (0, 1)), (1, (0, 1)))
    )
    assert alone.of["usual_velocity"] == alone.of["velocity"] == beside.of["velocity"]
    assert beside.of["usual_velocity"] == np.mean([alone.of["velocity"], other.of["velocity"]])
    assert other.of["usual_velocity"] == other.of["velocity"]

    def widest(model):
        (effect,) = (effect for effect in model.effects if effect.name == "stribeck_friction")
        (speed,) = (p for p in effect.parameters if p.name == "velocity_rad_s")
        return speed.high

    log_set = changed(logs, lambda t: replace(t, velocity=t.velocity * np.array([0.1, 1.0])))
    assert widest(Actuator().joints(log_set).models[0]) == pytest.approx(0.5 * beside.of["usual_velocity"])


def test_a_joint_at_its_end_stop_throughout_is_left_out(logs):
    marked = changed(logs, lambda t: replace(t, extra={f"joint/{t.joints[0]}/at_end_stop": np.ones(t.samples)}))
    joints = Actuator().joints(marked)
    assert joints.left == {logs.joints[0]: "only 0 windows of 100 samples away from its end stops"}
    assert [m.joint for m in joints.models] == [logs.joints[1]]


def test_samples_that_were_not_recorded_are_neither_judged_nor_started_from(logs):
    rng = np.random.default_rng(1)

    def lossy(t):
        observed = rng.random(t.position.shape) > 0.2
        observed[1000:1500, 0] = False
        return replace(t, observed=observed)

    partly = changed(logs, lossy)
    joint = Actuator().joints(partly).models[0]
    record, seen = joint.records[0], partly.fit[0].trajectory.observed[:, 0]
    at = (record.signals.first[:, None] + record.step)[record.judged]
    assert seen[record.signals.first].all() and seen[at].all()
    assert np.array_equal(joint.fit.output, partly.fit[0].trajectory.effort[at, 0])
    assert not np.any((joint.fit.time > 1.11) & (joint.fit.time < 1.4))
    assert np.isfinite(joint.error(neutral(joint))).all()


def test_sections_of_one_recording_are_one_file_and_no_window_crosses_their_ends(logs):
    trials = []
    for trial in logs.trials:
        t = trial.trajectory
        for start in (0, 1050, 2100):
            part = replace(t.section(start, start + 900), excerpt=Excerpt(trial.file, float(t.time[start]), t.duration))
            trials.append(replace(trial, file=f"{trial.file} ({start})", trajectory=part))
    joint = Actuator().joints(replace(logs, trials=tuple(trials))).models[0]
    samples, record = joint.fit, joint.records[0]
    assert samples.files == ("t0.parquet",) and np.all(np.diff(samples.time) > 0.0)
    part = np.searchsorted(record.signals.bounds, record.signals.first, side="right")
    last = np.searchsorted(record.signals.bounds, record.signals.first + record.signals.steps, side="right")
    assert np.array_equal(part, last) and set(part) == {1, 2, 3}
    whole = logs.fit[0].trajectory
    assert np.array_equal(samples.output, whole.effort[np.round(samples.time / DT).astype(int), 0])


def test_logs_without_held_out_trials_are_judged_on_the_fit_trials(logs):
    joint = Actuator().joints(replace(logs, trials=tuple(logs.fit)), window_s=0.1).models[0]
    assert joint.error(neutral(joint), True).shape == (0,) == joint.heldout.output.shape
    assert joint.heldout.files == () and len(joint.error(neutral(joint))) == len(joint.fit.output) > 0


def test_held_out_trials_shorter_than_a_window_hold_no_samples(logs):
    short = tuple(t if t.split == "fit" else replace(t, trajectory=t.trajectory.section(0, 50)) for t in logs.trials)
    joint = Actuator().joints(replace(logs, trials=short), window_s=0.1).models[0]
    assert joint.error(neutral(joint), True).shape == (0,) == joint.heldout.time.shape


def test_long_logs_are_judged_in_runs_all_over_them():
    trials = [Trial(f"t{i}.parquet", "fit", None, swinging(30.0, seed=i)) for i in range(2)]
    record = record_of(trials, 0, 100, (np.ones(1), np.ones(1)))
    assert record.windows == MOST_WINDOWS and record.judged.size <= MOST_SAMPLES
    s, run = record.signals, MOST_WINDOWS // FEWEST_RUNS
    assert len(s.bounds) == FEWEST_RUNS + 1 and s.bounds[-1] == len(s.command) == len(s.time)
    leads = np.array([0, *[100 * LEAD] * (FEWEST_RUNS - 1)])  # nothing comes before the first window
    assert len(s.command) == FEWEST_RUNS * (run * 100 + 1) + leads.sum()
    first = s.first.reshape(FEWEST_RUNS, run)
    assert np.array_equal(first[:, 0] - s.bounds[:-1], leads) and np.all(np.diff(first) == 100)
    for k, (at, trial) in enumerate(zip(first[:, 0], record.trial[::run], strict=True)):
        whole, now = trials[trial].trajectory, int(round(s.time[at] * 1e3))
        assert np.array_equal(s.command[at : at + 100], whole.position_command[now : now + 100, 0]), k
        assert np.array_equal(s.target[:, k * run], whole.effort[now : now + 101, 0])
    samples = record.samples()
    assert abs(np.mean(samples.trial) - 0.5) < 0.02 and samples.time.min() < 0.1 and samples.time.max() > 29.0


def test_runs_of_windows_that_lie_far_apart_are_followed_one_by_one():
    starts = np.concatenate([np.arange(0, 20_000, 100), np.arange(40_000, 60_000, 100)])
    parts = window_runs([60_001], [starts], 100)
    assert sum(len(part.first) for part in parts) == MOST_WINDOWS
    assert all(part.stop - part.start <= (MOST_WINDOWS // FEWEST_RUNS + LEAD) * 100 + 1 for part in parts)
    assert parts[-1].stop <= 60_001 and not any(20_100 < part.start < 40_000 - 100 * LEAD for part in parts)


def test_every_trial_has_two_runs_as_far_as_they_are_long_enough():
    starts = [np.arange(0, 9_900, 100)] * 9
    parts = window_runs([10_000] * 9, starts, 100)
    assert [part.trial for part in parts] == sorted([*range(9)] * 2)
    many = window_runs([10_000] * 60, [starts[0]] * 60, 100)
    assert sum(len(part.first) for part in many) == MOST_WINDOWS and len({part.trial for part in many}) == 24


def test_short_logs_are_not_thinned():
    record = record_of([Trial("t.parquet", "fit", None, swinging(7.0))], 0, 100, (np.ones(1), np.ones(1)))
    assert record.windows == 69 and np.array_equal(record.step, np.arange(1, 101))


REST = {
    "it never moves": ("position", lambda t: np.full(t.samples, 0.3)),
    "its measured torque never changes": ("effort", lambda t: np.full(t.samples, 7.0)),
    "its commanded position is its position in every sample": ("position_command", lambda t: t.position[:, 1]),
}


@pytest.mark.parametrize("reason", REST)
def test_a_joint_whose_signals_hold_nothing_is_left_out_with_the_reason(logs, reason):
    channel, make = REST[reason]
    joints = Actuator().joints(with_column(logs, channel, 1, make))
    assert [m.joint for m in joints.models] == [logs.joints[0]]
    assert list(joints.left) == [logs.joints[1]] and joints.left[logs.joints[1]].startswith(reason)
    assert np.isfinite(joints.models[0].error(neutral(joints.models[0]))).all()


def test_logs_in_which_every_joint_rests_are_refused(logs):
    still = changed(logs, lambda t: replace(t, position=0.0 * t.position, velocity=0.0 * t.velocity))
    with pytest.raises(IdentificationError, match="no joint can be judged .*it never moves"):
        Actuator().joints(still)


@pytest.mark.parametrize("column", ["position_command", "effort"])
def test_logs_that_lack_a_column_are_refused_with_its_name(logs, column):
    bare = changed(logs, lambda t: replace(t, **{column: None}))
    assert Actuator().lacking(bare) == [column]
    with pytest.raises(IdentificationError, match=column) as told:
        Actuator().joints(bare)
    assert told.value.field == column and Path(told.value.file) == logs.path


def test_short_logs_are_refused():
    with pytest.raises(IdentificationError, match="windows of 100 samples"):
        Actuator().joints(planted_logs({}, seconds=0.6), window_s=0.1)


def test_effects_are_left_out_where_asked_and_slack_where_the_sign_was_lost(logs):
    joints = Actuator(unsigned=[logs.joints[0]]).joints(logs, without=("valve_lag",))
    first, second = ({e.name for e in m.effects} for m in joints.models)
    assert second - first == {"backlash"} and "valve_lag" not in first | second


def test_the_torque_is_limited_where_a_limit_is_stated(logs):
    limited = Actuator({logs.joints[0]: 20.0}).joints(logs).models
    samples, error = limited[0].fit, limited[0].error(neutral(limited[0]))
    assert np.max(np.abs(samples.output + error)) <= 20.0 + 1e-9
    other = limited[1].fit.output + limited[1].error(neutral(limited[1]))
    assert np.max(np.abs(other)) > 20.0


def test_a_joint_that_stands_still_beside_one_that_moves_does_not_hinder_its_answer(logs):
    still = with_column(logs, "position", 1, lambda t: np.zeros(t.samples))
    still = with_column(still, "velocity", 1, lambda t: np.zeros(t.samples))
    (found,) = identify(Actuator().joints(still)).found
    assert found.causes == ()


def test_noise_within_the_slack_of_a_chain_is_not_taken_for_its_torque(monkeypatch):
    """Noise of a third of the usual torque; were a torque of half of the usual one taken for a tight chain, a window that
    begins within the slack would begin at one of its ends, and the squared error would be 1.7 times that of the noise."""
    monkeypatch.setattr(planted, "LOAD", 0.0)
    gap = 0.008
    logs = planted_logs({"backlash": {"gap": gap}}, seconds=20.0, noise=12.0, motion=0.05, knocks=20.0)
    (model,) = Actuator().joints(logs).models
    values, names = neutral(model), parameter_names(model)
    for name, value in planted.GAINS.items():
        values[names.index(("", name))] = value
    values[names.index(("backlash", "gap"))] = gap
    assert np.mean(model.error(values) ** 2) < 1.1 * model.noise[0] ** 2
