"""What a defect costs, and that it costs no more: parts of the logs are left out until the rest is sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, real, rows, values
from planted_logs import logs_of

from hqpipe.gap.checks.defect import KINDS, Defect, of_channel
from hqpipe.gap.checks.left_out import leave_out
from hqpipe.gap.checks.signs import restore_efforts
from hqpipe.gap.intake import take_in

WINDOW_S = 0.1
SHUFFLED = rows(lambda n: np.random.default_rng(0).permutation(n))


@pytest.fixture(scope="module")
def sound():
    """Six trials of four joints, the last two held out."""
    logs = logs_of([{}, {}, {}, {}], seconds=4.0)
    fit, heldout = logs.fit[0], logs.heldout[0]
    trials = []
    for i in range(6):
        trial = heldout if i > 3 else fit
        part = trial.trajectory.section(500 * (i % 4), trial.trajectory.samples - 500 * (3 - i % 4))
        trials.append(replace(trial, file=f"t{i}.parquet", trajectory=part))
    return replace(logs, trials=tuple(trials))


def what(intake):
    return [(item.kind, item.channel, item.joints, item.trials) for item in intake.left_out]


def files(intake):
    return [trial.file for trial in intake.log_set.trials]


def test_sound_logs_keep_everything(sound):
    intake = take_in(sound, WINDOW_S)
    assert intake.left_out == () and intake.reasons == () and intake.log_set.joints == sound.joints


@pytest.mark.parametrize("name", ["emps", "so101", "cranfield_ref", "cranfield_same", "cranfield_lube1"])
def test_real_machines_lose_no_joint_and_no_trial(name):
    logs = real(name)
    intake = take_in(logs, max(WINDOW_S, 10.0 / logs.rate_hz))
    assert intake.reasons == () and all(item.channel for item in intake.left_out), intake.left_out
    assert intake.log_set.joints == logs.joints and len(intake.log_set.trials) == len(logs.trials)


def test_one_shuffled_trial_costs_that_trial(sound):
    intake = take_in(broken(sound, SHUFFLED, only=[1]), WINDOW_S)
    assert what(intake) == [("rows_out_of_order", None, (), ("t1.parquet",))]
    assert files(intake) == ["t0.parquet", "t2.parquet", "t3.parquet", "t4.parquet", "t5.parquet"]
    assert intake.log_set.joints == sound.joints and intake.reasons == ()


def test_a_flipped_sign_everywhere_costs_that_joint(sound):
    intake = take_in(broken(sound, values("effort", np.negative, 2)), WINDOW_S)
    assert what(intake) == [("sign_flipped", None, (sound.joints[2],), tuple(t.file for t in sound.trials))]
    assert intake.log_set.joints == (*sound.joints[:2], sound.joints[3])
    assert all(trial.trajectory.joints == intake.log_set.joints for trial in intake.signed.raw.trials)
    mended = intake.spare[sound.joints[2]].trials[0].trajectory
    np.testing.assert_array_equal(mended.effort[:, 0], sound.trials[0].trajectory.effort[:, 2])


def test_a_flipped_sign_in_one_trial_costs_the_trial_where_that_is_less(sound):
    one = broken(sound, values("effort", np.negative, 2), only=[0])
    intake = take_in(one, WINDOW_S)
    assert what(intake) == [("sign_flipped", None, (), ("t0.parquet",))] and intake.log_set.joints == sound.joints


def test_several_defects_cost_what_each_has(sound):
    logs = broken(broken(sound, SHUFFLED, only=[1]), values("effort", np.negative, 2))
    intake = take_in(logs, WINDOW_S)
    assert {item.kind for item in intake.left_out} == {"rows_out_of_order", "sign_flipped"}
    assert "t1.parquet" not in files(intake) and sound.joints[2] not in intake.log_set.joints
    assert intake.reasons == ()


def test_two_defects_of_one_kind_in_one_trial_cost_it_once(sound):
    def rotten(t):
        return values("position_command", np.negative, 1)(values("effort", np.negative, 2)(t))

    intake = take_in(broken(broken(sound, rotten, only=[0]), values("effort", np.negative, 2), only=[1]), WINDOW_S)
    assert sorted(item.trials for item in intake.left_out) == [("t0.parquet",), ("t1.parquet",)]
    assert intake.log_set.joints == sound.joints and len(intake.log_set.trials) == 4


def test_two_channels_of_a_joint_out_of_order_cost_it_once(sound):
    def rotten(t):
        return rows(lambda n: np.random.default_rng(1).permutation(n), "effort")(t)

    def spoilt(t):
        one = [2]
        effort, command = t.effort.copy(), t.position_command.copy()
        effort[:, one], command[:, one] = rotten(t).effort[:, one], SHUFFLED(t).position_command[:, one]
        return replace(t, effort=effort, position_command=command)

    intake = take_in(broken(sound, spoilt), WINDOW_S)
    assert intake.reasons == () and intake.log_set.joints == (*sound.joints[:2], sound.joints[3])
    assert [item.joints for item in intake.left_out] == [(sound.joints[2],)]
    assert intake.spare[sound.joints[2]] is None


def test_the_last_held_out_trial_is_not_given_up_for_one_joint(sound):
    few = replace(sound, trials=sound.trials[:5])
    intake = take_in(broken(few, values("effort", np.negative, 2), only=[4]), WINDOW_S)
    assert [item.joints for item in intake.left_out] == [(sound.joints[2],)] and len(intake.log_set.trials) == 5


def test_an_effort_without_a_sign_is_shuffled_even_if_a_sign_can_be_given_to_it(sound):
    def unsigned(t):
        return values("effort", np.abs)(t)

    def mixed(t):
        effort = t.effort.copy()
        effort[:, 1] = SHUFFLED(t).effort[:, 1]
        return replace(t, effort=effort)

    intake = take_in(broken(broken(sound, unsigned), mixed, only=[0]), WINDOW_S)
    assert what(intake) == [("rows_out_of_order", None, (), ("t0.parquet",))]
    assert set(intake.signed.joints) == set(sound.joints)


def test_a_restored_sign_is_not_called_flipped(sound, monkeypatch):
    from hqpipe.gap import intake as module

    def misjudged(log_set, without=()):
        signed = restore_efforts(log_set, without)
        return replace(signed, log_set=broken(signed.log_set, values("effort", np.negative, 2), only=[0]))

    monkeypatch.setattr(module, "restore_efforts", misjudged)
    assert take_in(broken(sound, values("effort", np.abs)), WINDOW_S).left_out == ()


def test_nothing_left_ends_with_every_reason(sound):
    intake = take_in(broken(sound, SHUFFLED), WINDOW_S)
    assert len(intake.reasons) == 1 and "rows out of order in every trial" in intake.reasons[0]
    assert intake.advice.startswith("correct the logs")


def test_a_trial_in_another_unit_costs_that_trial(sound):
    def degrees(t):
        return replace(t, **{n: 180.0 / np.pi * getattr(t, n) for n in ("position", "velocity", "position_command")})

    intake = take_in(broken(sound, degrees, only=[3]), WINDOW_S)
    assert ("other_units", None, (), ("t3.parquet",)) in what(intake) and len(intake.log_set.trials) == 5


def test_a_livelier_trial_is_in_no_other_unit(sound):
    def lively(t):
        channels = {n: getattr(t, n) * 20.0 for n in ("position", "velocity", "position_command", "effort")}
        return replace(t, **channels)

    intake = take_in(broken(sound, lively, only=[3]), WINDOW_S)
    assert "other_units" not in {item.kind for item in intake.left_out}


def test_a_velocity_that_matters_is_taken_from_the_positions(sound):
    intake = take_in(broken(sound, values("velocity", np.negative, 1)), WINDOW_S)
    assert [(item.kind, item.channel, item.joints) for item in intake.left_out] == [
        ("sign_flipped", "velocity", (sound.joints[1],))
    ]
    speeds = (intake.log_set.trials[0].trajectory.velocity, sound.trials[0].trajectory.velocity)
    assert np.corrcoef(*(speed[:, 1] for speed in speeds))[0, 1] > 0.98
    assert intake.log_set.joints == sound.joints


def test_a_velocity_in_another_unit_costs_nothing_where_a_coefficient_takes_it_up(sound):
    intake = take_in(broken(sound, values("velocity", lambda v: 57.2958 * v, 1)), WINDOW_S)
    assert intake.left_out == () and any("degrees per second" in text for text in intake.warnings)


def defect(logs, kind="sign_flipped", channel="effort", joints=(0,), trials=None):
    names = [logs.joints[j] for j in joints]
    trials = [t.file for t in logs.trials] if trials is None else trials
    return of_channel(kind, channel, names, trials, len(logs.trials), "is broken; mend it")


def test_what_each_defect_costs(sound):
    rest, (item,) = leave_out(defect(sound), sound)
    assert rest.joints == sound.joints[1:] and item.reason.endswith("is broken") and item.fix == "mend it"
    rest, (item,) = leave_out(defect(sound, trials=["t0.parquet"]), sound)
    assert item.trials == ("t0.parquet",) and item.joints == () and len(rest.trials) == 5
    rest, (item,) = leave_out(
        defect(sound, joints=(0, 1, 2), trials=["t0.parquet", "t1.parquet", "t2.parquet", "t3.parquet"]), sound
    )
    assert item.joints == sound.joints[:3], "in most of the trials of the joints"
    assert leave_out(defect(sound, joints=(0, 1, 2, 3)), sound)[0] is None
    whole = Defect("rows_out_of_order", tuple(t.file for t in sound.fit), (), None, "broken; mend it", fatal=True)
    assert leave_out(whole, sound)[0] is None


def test_a_channel_that_no_model_reads_costs_itself_only(sound):
    pressed = broken(sound, lambda t: replace(t, pressure_a=t.effort * 1e5, pressure_b=-t.effort * 1e5))
    rest, items = leave_out(defect(pressed, "constant", "pressure_a"), pressed)
    assert [(item.channel, item.joints) for item in items] == [("pressure_a", sound.joints[:1])]
    t = rest.trials[0].trajectory
    assert not t.pressure_a[:, 0].any() and not t.pressure_b[:, 0].any() and t.pressure_a[:, 1].any()


def test_every_kind_is_one_of_the_documented(sound):
    assert all(item.kind in KINDS for item in take_in(broken(sound, SHUFFLED, only=[1]), WINDOW_S).left_out)


def test_both_parts_of_a_lone_trial_are_told_apart(sound):
    t = sound.trials[0]
    lone = replace(sound, trials=(t, replace(sound.trials[4], file=t.file), replace(t, file="b.parquet")))
    intake = take_in(broken(lone, SHUFFLED, only=[0]), WINDOW_S)
    assert [item.trials for item in intake.left_out] == [("t0.parquet (fit part)",)]
    assert [(trial.file, trial.split) for trial in intake.log_set.trials] == [
        ("t0.parquet", "heldout"),
        ("b.parquet", "fit"),
    ]
