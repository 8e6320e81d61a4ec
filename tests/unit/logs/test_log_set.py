"""Reading sound log sets, with and without logset.yaml."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import JOINTS, make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.audit import audit
from hqpipe.logs.log_set import read_log_set

YAML = """
format: hqpipe-log/1
robot: two_joints
base: fixed
control_mode: position
effort_source: load_cell
rate_hz: 1000
trials:
  - {file: b.parquet, split: fit, command: {vx: 0.4}}
  - {file: a.parquet, split: heldout}
"""


def test_values_arrive_in_the_right_joint_and_channel(logs, columns):
    trial = read_log_set(logs).trials[0].trajectory
    assert trial.joints == JOINTS
    for j, joint in enumerate(JOINTS):
        for channel in ("position", "velocity", "effort", "position_command"):
            stored = getattr(trial, channel)
            assert stored.dtype == np.float64
            np.testing.assert_array_equal(stored[:, j], columns[f"joint/{joint}/{channel}"])
    assert trial.effort_command is None
    assert trial.velocity_source == "measured"
    assert trial.dt == pytest.approx(1e-3)


def test_without_manifest_the_last_trial_is_held_out(logs):
    log_set = read_log_set(logs)
    assert [(t.file, t.split) for t in log_set.trials] == [("a.parquet", "fit"), ("b.parquet", "heldout")]
    assert log_set.control_mode == "position"
    assert log_set.rate_hz == 1000
    assert "held out: b.parquet" in log_set.warnings[0]


def test_a_lone_trial_is_cut_with_a_gap(tmp_path):
    put(tmp_path / "one", "a.parquet", make_columns(samples=20_000))
    fit, heldout = read_log_set(tmp_path / "one").trials
    assert (fit.split, heldout.split) == ("fit", "heldout")
    assert heldout.trajectory.samples == 5000
    assert fit.trajectory.samples == 14_500
    assert heldout.trajectory.time[0] == 0.0


def test_manifest_decides(logs):
    (logs / "logset.yaml").write_text(YAML)
    log_set = read_log_set(logs)
    assert (log_set.robot, log_set.base, log_set.effort_source) == ("two_joints", "fixed", "load_cell")
    assert [t.file for t in log_set.fit] == ["b.parquet"]
    assert log_set.fit[0].command == {"vx": 0.4}
    assert [t.file for t in log_set.heldout] == ["a.parquet"]
    assert log_set.warnings == ()


def test_unlisted_files_and_no_heldout_are_said(logs):
    (logs / "logset.yaml").write_text("format: hqpipe-log/1\ntrials:\n  - {file: a.parquet, split: fit}\n")
    text = "\n".join(read_log_set(logs).warnings)
    assert "does not list b.parquet" in text
    assert "holds out no trial" in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("effort_source", "effort_sauce", "unknown field 'effort_sauce' – did you mean 'effort_source'"),
        ("load_cell", "loadcell", "effort_source is 'loadcell' – did you mean 'load_cell'"),
        ("hqpipe-log/1", "hqpipe-log/2", "expected hqpipe-log/1"),
        ("b.parquet", "bb.parquet", "no file 'bb.parquet' – did you mean 'b.parquet'"),
        ("b.parquet", "../b.parquet", "expected a path inside the log set"),
        ("b.parquet", "a.parquet", "listed twice"),
        ("split: heldout", "split: held_out", "did you mean 'heldout'"),
        ("split: fit", "split: heldout", "none has split: fit"),
        ("command:", "comand:", "unknown field 'trials[0].comand' – did you mean 'command'"),
        ("rate_hz: 1000", "rate_hz: fast", "rate_hz is 'fast'"),
        ("{vx: 0.4}", "{vx: quick}", "expected numbers"),
        ("control_mode: position", "control_mode: valve", "no column 'joint/hip/valve_command'"),
        ("trials:", "trials: {", "not valid YAML"),
    ],
)
def test_a_wrong_manifest_is_named(logs, old, new, words):
    assert old in YAML
    (logs / "logset.yaml").write_text(YAML.replace(old, new, 1))
    with pytest.raises(LogError) as info:
        read_log_set(logs)
    assert words in str(info.value)
    assert "logset.yaml" in str(info.value)


def test_manifest_never_builds_objects(logs):
    (logs / "logset.yaml").write_text("format: !!python/object/apply:os.getcwd []\n")
    with pytest.raises(LogError, match="not valid YAML"):
        read_log_set(logs)


@pytest.mark.parametrize("manifest", [None, YAML, YAML.replace("split: fit", "split: heldout")])
def test_a_set_can_be_read_for_judging_alone(logs, manifest):
    if manifest:
        (logs / "logset.yaml").write_text(manifest)
    log_set = read_log_set(logs, all_heldout=True)
    assert sorted(trial.file for trial in log_set.heldout) == ["a.parquet", "b.parquet"]
    assert log_set.fit == []


@pytest.mark.parametrize("manifest", [None, YAML])
def test_a_log_set_in_a_subfolder_is_another_one(logs, manifest):
    if manifest:
        (logs / "logset.yaml").write_text(manifest)
    before = read_log_set(logs)
    put(logs / "stress", "c.parquet", make_columns(seed=2))
    after = read_log_set(logs)
    assert after.header() == before.header()
    assert [t.file for t in after.trials] == [t.file for t in before.trials]


def test_joint_order_follows_the_first_trial(logs, columns):
    shuffled = {"time": columns["time"]} | dict(reversed(list(make_columns(seed=1).items())))
    put(logs, "b.parquet", shuffled)
    second = read_log_set(logs).trials[1].trajectory
    assert second.joints == JOINTS
    np.testing.assert_array_equal(second.position[:, 1], shuffled["joint/knee/position"])


def test_missing_velocity_is_differentiated_and_said(logs):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        kept = {k: v for k, v in make_columns(seed=seed).items() if not k.endswith("velocity")}
        put(logs, file, kept)
    log_set = read_log_set(logs)
    trial = log_set.trials[0].trajectory
    assert trial.velocity_source == "differentiated"
    assert any("differentiated from position" in w for w in log_set.warnings)
    truth = np.stack([make_columns()[f"joint/{j}/velocity"] for j in JOINTS], axis=1)
    assert np.sqrt(np.mean((trial.velocity - truth) ** 2)) < 0.01 * truth.std()


def test_digest_covers_every_used_byte(logs, columns):
    before = read_log_set(logs).sha256
    assert read_log_set(logs).sha256 == before
    (logs / "notes.txt").write_text("not a trial")
    assert read_log_set(logs).sha256 == before
    columns["joint/hip/position"][700] += 1e-9
    put(logs, "a.parquet", columns)
    assert read_log_set(logs).sha256 != before


def test_other_columns_are_kept(logs, columns):
    columns["battery/voltage"] = np.linspace(24, 23, 2000)
    put(logs, "a.parquet", columns)
    extra = read_log_set(logs).trials[0].trajectory.extra
    np.testing.assert_array_equal(extra["battery/voltage"], columns["battery/voltage"])


def test_audit_is_plain_data(logs):
    import json

    summary = json.loads(json.dumps(audit(read_log_set(logs))))
    assert summary["trials"][0]["samples"] == 2000
    assert summary["trials"][0]["rate_hz"] == pytest.approx(1000.0)
    assert summary["ranges"]["knee"]["position"]["max"] == pytest.approx(0.4, abs=1e-3)
    assert summary["duration_s"] == {"fit": 1.999, "heldout": 1.999}


def test_a_current_of_some_joints_only_is_kept_under_its_name(logs):
    for seed, file in enumerate(("a.parquet", "b.parquet")):
        put(logs, file, make_columns(seed=seed) | {"joint/hip/current": np.full(2000, 1.5)})
    trial = read_log_set(logs).trials[0].trajectory
    assert trial.current is None and trial.extra["joint/hip/current"][0] == 1.5
