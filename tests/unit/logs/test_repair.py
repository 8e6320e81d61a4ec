"""Logs with lost samples, jitter, gaps and several rates are used without them, and the answer says so."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import JOINTS, make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set
from hqpipe.logs.repair.segments import bridgeable, stretches


def kept(columns, rows):
    return {name: values[rows] for name, values in columns.items()}


def without_rows(samples, lost):
    rows = np.ones(samples, dtype=bool)
    rows[lost] = False
    return rows


def warning(log_set, word):
    found = [text for text in log_set.warnings if word in text]
    assert len(found) == 1, log_set.warnings
    return found[0]


def test_sound_logs_are_not_touched(logs, columns):
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    for j, joint in enumerate(JOINTS):
        np.testing.assert_array_equal(trial.effort[:, j], columns[f"joint/{joint}/effort"])
    np.testing.assert_array_equal(trial.time, columns["time"])
    assert trial.observed is None and trial.excerpt is None and not log_set.repairs


def test_a_lost_sample_is_bridged_and_counts_for_nothing(logs, columns):
    truth = columns["joint/knee/effort"][500]
    columns["joint/knee/effort"][[500, 900]] = np.nan
    put(logs, "a.parquet", columns)
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    assert trial.samples == 2000 and abs(trial.effort[500, 1] - truth) < 5.0
    assert np.argwhere(~trial.observed).tolist() == [[500, 1], [900, 1]]
    assert "2 values without sense in joint/knee/effort" in warning(log_set, "without sense")


def test_values_beyond_sense_are_lost_samples(logs, columns):
    columns["joint/hip/position"][700] = 1e30
    put(logs, "a.parquet", columns)
    trial = read_log_set(logs).trials[0].trajectory
    assert abs(trial.position[700, 0] - 0.5 * (trial.position[699, 0] + trial.position[701, 0])) < 1e-9
    assert not trial.observed[700, 0] and trial.observed[700, 1]


def test_lost_rows_come_back_on_the_same_clock(logs, columns):
    put(logs, "a.parquet", kept(columns, without_rows(2000, [300, 301, 1000])))
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    np.testing.assert_allclose(trial.time, columns["time"], atol=1e-9)
    assert np.flatnonzero(~trial.observed[:, 0]).tolist() == [300, 301, 1000]
    np.testing.assert_allclose(trial.position[:, 0], columns["joint/hip/position"], atol=1e-4)
    last = columns["joint/hip/position_command"][299]
    np.testing.assert_array_equal(trial.position_command[300:302, 0], [last, last])
    assert "3 of 4000 rows" in warning(log_set, "missing by the clock")


def test_a_long_gap_cuts_a_trial(logs, columns):
    put(logs, "a.parquet", kept(columns, without_rows(2000, np.r_[600:700])))
    log_set = read_log_set(logs)
    first, second, other = log_set.trials
    assert [first.file, second.file] == ["a.parquet (0.00–0.60 s)", "a.parquet (0.70–2.00 s)"]
    assert first.split == second.split == "fit" and other.split == "heldout"
    assert second.trajectory.excerpt.recording == "a.parquet"
    assert second.trajectory.start == pytest.approx(0.7) and second.trajectory.time[0] == 0.0
    np.testing.assert_array_equal(second.trajectory.effort[:, 0], columns["joint/hip/effort"][700:])
    assert "1 trial was cut into 2 stretches" in warning(log_set, "stretches")


def test_a_velocity_is_not_differentiated_across_a_gap(logs, columns):
    for file, each in (("a.parquet", columns), ("b.parquet", make_columns(seed=1))):
        bare = {name: values for name, values in each.items() if not name.endswith("velocity")}
        put(logs, file, kept(bare, without_rows(2000, np.r_[600:900])))
    truth = columns["joint/hip/velocity"]
    first, second = [t.trajectory for t in read_log_set(logs).trials[:2]]
    assert abs(first.velocity[-3, 0] - truth[597]) < 0.1 and abs(second.velocity[2, 0] - truth[902]) < 0.1


def test_a_lone_trial_with_gaps_is_split_in_time(tmp_path, columns):
    folder = tmp_path / "one"
    put(folder, "a.parquet", kept(columns, without_rows(2000, np.r_[600:700, 1800:1850])))
    trials = read_log_set(folder).trials
    fit = [t for t in trials if t.split == "fit"]
    held = [t for t in trials if t.split == "heldout"]
    assert max(t.trajectory.start + t.trajectory.duration for t in fit) < min(t.trajectory.start for t in held)
    assert sum(t.trajectory.samples for t in held) == round(0.25 * 1850)


@pytest.mark.parametrize("size", [0.1, 0.3])
def test_jitter_is_taken_away(logs, columns, size):
    rng = np.random.default_rng(0)
    true = columns["time"] + rng.uniform(-size, size, 2000) * 1e-3
    columns = {name: np.interp(true, columns["time"], values) for name, values in columns.items()} | {"time": true}
    put(logs, "a.parquet", columns)
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    np.testing.assert_allclose(np.diff(trial.time), 1e-3, rtol=1e-3)
    truth = make_columns()["joint/hip/position"]
    grid = np.interp(trial.time + true[0], make_columns()["time"], truth)
    assert np.std(trial.position[:, 0] - grid) < 5e-5
    assert "jitters" in warning(log_set, "jitters") and "1000 Hz" in warning(log_set, "jitters")


def test_trials_of_two_rates_share_the_one_of_most_samples(logs):
    slow = make_columns(samples=500, rate=100.0, seed=1)
    put(logs, "b.parquet", kept(make_columns(samples=20_000, rate=1000.0, seed=2), slice(None)))
    put(logs, "c.parquet", slow)
    log_set = read_log_set(logs)
    assert [round(1.0 / t.trajectory.dt) for t in log_set.trials] == [1000, 1000, 1000]
    trial = log_set.trials[2].trajectory
    assert trial.observed[::10].all() and not trial.observed[5::10].any()
    np.testing.assert_allclose(trial.effort[::10, 0], slow["joint/hip/effort"], atol=1e-6)
    np.testing.assert_array_equal(trial.position_command[10:20, 0], slow["joint/hip/position_command"][1])
    assert "c.parquet ran at 100 Hz" in warning(log_set, "most samples")


def test_a_faster_trial_is_averaged_before_it_is_thinned_out(logs):
    put(logs, "a.parquet", make_columns(samples=2000, rate=100.0))
    put(logs, "b.parquet", make_columns(samples=2000, rate=100.0, seed=1))
    fast = make_columns(samples=3000, rate=1000.0, seed=2)
    put(logs, "c.parquet", fast)
    trial = read_log_set(logs).trials[2].trajectory
    clean = 3000.0 * (fast["joint/hip/position_command"] - fast["joint/hip/position"])
    assert trial.samples == 300 and trial.observed is None
    assert np.std(trial.effort[5:-5, 0] - clean[::10][5:-5]) < np.std(fast["joint/hip/effort"] - clean)


def test_a_trial_in_another_unit_of_time_is_left_out(logs, columns):
    put(logs, "b.parquet", make_columns(seed=1))
    put(logs, "c.parquet", make_columns(seed=2))
    columns["time"] = columns["time"] * 1e6
    put(logs, "a.parquet", columns)
    log_set = read_log_set(logs)
    assert [t.file for t in log_set.trials] == ["b.parquet", "c.parquet"]
    assert "time steps by 1000 there and by 0.001 in the other trials" in warning(log_set, "left out")


def test_rows_that_repeat_a_time_are_left_out(logs, columns):
    twice = np.sort(np.r_[0:2000, 100, 1500])
    put(logs, "a.parquet", kept(columns, twice))
    log_set = read_log_set(logs)
    np.testing.assert_array_equal(log_set.trials[0].trajectory.effort[:, 0], columns["joint/hip/effort"])
    assert warning(log_set, "bear the time").startswith("2 rows")


def test_a_joint_without_a_signal_is_left_out(logs, columns):
    for file, each in (("a.parquet", columns), ("b.parquet", make_columns(seed=1))):
        each["joint/knee/effort"][:] = np.nan
        put(logs, file, each)
    log_set = read_log_set(logs)
    assert log_set.joints == ("hip",)
    text = warning(log_set, "left out")
    assert "joint knee was left out: joint/knee/effort lacks 100% of its samples in a.parquet, b.parquet" in text


def test_a_trial_without_a_signal_is_left_out(logs, columns):
    put(logs, "c.parquet", make_columns(seed=2))
    columns["joint/knee/effort"][:1500] = np.inf
    put(logs, "a.parquet", columns)
    log_set = read_log_set(logs)
    assert [t.file for t in log_set.trials] == ["b.parquet", "c.parquet"] and log_set.joints == JOINTS
    assert "a.parquet was left out: joint/knee/effort lacks 75%" in warning(log_set, "left out")


def test_a_velocity_that_is_missing_comes_from_the_position(logs, columns):
    truth = columns["joint/knee/velocity"].copy()
    columns["joint/knee/velocity"][:] = np.nan
    put(logs, "a.parquet", columns)
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    assert np.std(trial.velocity[:, 1] - truth) < 0.05
    np.testing.assert_array_equal(trial.velocity[:, 0], columns["joint/hip/velocity"])
    assert "had from the position" in warning(log_set, "from the position")


def test_another_channel_that_is_missing_is_dropped(logs, columns):
    for file, each in (("a.parquet", columns), ("b.parquet", make_columns(seed=1))):
        each |= {f"joint/{joint}/pressure_a": np.full(2000, 1e6) for joint in JOINTS} | {
            "supply/pressure": np.full(2000, 2e7)
        }
        if file == "a.parquet":
            each["joint/hip/pressure_a"][10:] = np.nan
            each["supply/pressure"][5:] = np.nan
        put(logs, file, each)
    trials = [t.trajectory for t in read_log_set(logs).trials]
    assert all(t.pressure_a is None for t in trials)
    assert "supply/pressure" not in trials[0].extra and "supply/pressure" in trials[1].extra


def test_nothing_left(logs, columns):
    for file, each in (("a.parquet", columns), ("b.parquet", make_columns(seed=1))):
        for joint in JOINTS:
            each[f"joint/{joint}/position_command"][:] = np.nan
        put(logs, file, each)
    with pytest.raises(LogError, match="nothing that can be used is left") as info:
        read_log_set(logs)
    assert info.value.field == "joint/hip/position_command" and info.value.fix


def test_no_fit_trial_left(logs, columns):
    columns["joint/knee/effort"][:] = np.nan
    put(logs, "a.parquet", columns)
    put(logs, "c.parquet", make_columns(seed=2))
    put(logs, "d.parquet", make_columns(seed=3))
    (logs / "logset.yaml").write_text(
        "format: hqpipe-log/1\ntrials:\n"
        + "".join(
            f"  - {{file: {f}.parquet, split: {s}}}\n" for f, s in zip("abcd", ("fit", *["heldout"] * 3), strict=True)
        )
    )
    with pytest.raises(LogError, match="no trial with split: fit is left .a.parquet was left out"):
        read_log_set(logs)


def test_a_slow_motion_bridges_more_than_a_fast_one():
    time = np.arange(4000) / 1000.0
    assert bridgeable([np.sin(2 * np.pi * 0.5 * time)]) == 9
    assert bridgeable([np.sin(2 * np.pi * 12.0 * time)]) == 3
    assert bridgeable([np.sin(2 * np.pi * 100.0 * time)]) == 1


@pytest.mark.parametrize(
    ("lost", "missing", "expected"),
    [
        ([], [], [(0, 100)]),
        ([(49, 2)], [], [(0, 100)]),
        ([(49, 4)], [], [(0, 50), (50, 100)]),
        ([], [40, 41, 42], [(0, 100)]),
        ([], [40, 41, 42, 43], [(0, 40), (44, 100)]),
        ([], [0, 99], [(1, 99)]),
        ([(49, 4)], [49, 50], [(0, 49), (51, 100)]),
        ([(5, 4)], [], [(6, 100)]),
    ],
)
def test_stretches(lost, missing, expected):
    steps, absent = np.zeros(99, dtype=int), np.zeros(100, dtype=bool)
    for row, count in lost:
        steps[row] = count
    absent[missing] = True
    assert stretches(steps, absent, 3, 10) == expected
