"""Every defect of a log is an error that names file, column, row and the mend – and nothing is half-read."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.log_set import read_log_set


def refusal(logs, columns, file="a.parquet", **options):
    put(logs, file, columns)
    with pytest.raises(LogError) as info:
        read_log_set(logs, **options)
    assert file in str(info.value)
    assert info.value.file and info.value.fix
    return str(info.value)


def renamed(columns, old, new):
    return {(new if name == old else name): values for name, values in columns.items()}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("time", "Time", "no column 'time' – did you mean 'Time'"),
        ("time", "stamp", "no column 'time'"),
        ("joint/hip/position", "joint/hip/positon", "'joint/hip/positon' is unknown"),
        ("joint/hip/effort", "joint/hip/torque", "did you mean 'joint/hip/effort'"),
        (
            "joint/knee/position_command",
            "joint/knee/position_cmd",
            "did you mean 'joint/knee/position_command'",
        ),
        ("joint/knee/effort", "knee_load", "no column 'joint/knee/effort' although joint hip has"),
        ("joint/knee/position", "knee_place", "every joint needs its position"),
        ("joint/knee/effort", "knee_effort", "rename column 'knee_effort' to 'joint/knee/effort'"),
        ("joint/knee/position", "knee/position", "rename column 'knee/position' to 'joint/knee/position'"),
        ("joint/knee/effort", "joint/knee/efort", "rename column 'joint/knee/efort' to 'joint/knee/effort'"),
        ("joint/knee/effort", "joint/knee/Effort", "rename column 'joint/knee/Effort' to 'joint/knee/effort'"),
        ("joint/knee/effort", "joint/knee/eff", "rename column 'joint/knee/eff' to 'joint/knee/effort'"),
        ("joint/knee/effort", "joint/knee/measured torque", "to 'joint/knee/effort'"),
        ("joint/knee/effort", "joint.knee.effort", "rename column 'joint.knee.effort' to 'joint/knee/effort'"),
        ("joint/knee/position_command", "joint_knee_position_command", "to 'joint/knee/position_command'"),
        ("joint/knee/position", "Joint/knee/Position", "rename column 'Joint/knee/Position' to 'joint/knee/position'"),
        ("joint/knee/position", "joints/knee/position", "to 'joint/knee/position'"),
        ("time", "t", "rename column 't' to 'time'"),
        ("time", "timestamp", "rename column 'timestamp' to 'time'"),
        ("joint/knee/effort", "joint/leg/knee/effort", "expected joint/<name>/<channel>"),
    ],
)
def test_missing_and_misspelt_columns(logs, columns, old, new, words):
    assert words in refusal(logs, renamed(columns, old, new))


@pytest.mark.parametrize("name", ["hip.position", "hip_position", "hip/position", "Hip/Position", "hip_q"])
def test_a_lone_joint_under_another_name(logs, name):
    words = refusal(logs, {"time": np.arange(50.0), name: np.zeros(50)})
    assert f"rename column '{name}' to 'joint/" in words


@pytest.mark.parametrize("name", ["", " ", " hip", "hip ", "a\nb", "a\x00b", "a\x1b[31mb", "x" * 5000])
def test_joint_names_that_cannot_be_shown(logs, columns, name):
    words = refusal(logs, {key.replace("/hip/", f"/{name}/"): values for key, values in columns.items()})
    assert "the joint name" in words and words.isprintable() and len(words) < 600


def test_too_many_joints(logs):
    columns = {"time": np.arange(50.0)} | {f"joint/{i}/position": np.zeros(50) for i in range(600)}
    assert "600 joints, expected at most 512" in refusal(logs, columns)


def test_no_joint_at_all(logs):
    words = refusal(logs, {"time": np.arange(50.0), "q0": np.zeros(50)})
    assert "no column joint/<name>/position; the file has q0, time" in words


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_not_finite(logs, columns, bad):
    columns["joint/knee/effort"][[123, 456]] = bad
    words = refusal(logs, columns, strict=True)
    assert "column 'joint/knee/effort', row 123" in words and "2 such rows" in words


def test_null(logs, columns):
    import pyarrow as pa

    values = [None if i == 17 else float(v) for i, v in enumerate(columns["joint/knee/effort"])]
    words = refusal(logs, columns | {"joint/knee/effort": pa.array(values)}, strict=True)
    assert "column 'joint/knee/effort', row 17: nan (1 such row), expected a finite number" in words


def test_text_column(logs, columns):
    words = refusal(logs, columns | {"mode": np.array(["walk"] * 2000)})
    assert "column 'mode' holds string, expected numbers" in words


def test_clock_repeats(logs, columns):
    columns["time"][100] = columns["time"][99]
    words = refusal(logs, columns, strict=True)
    assert "column 'time', row 100" in words and "the clock repeats" in words


def test_clock_stands_still(logs, columns):
    columns["time"][100:200] = columns["time"][100]
    words = refusal(logs, columns)
    assert "column 'time', row 101" in words and "the clock repeats (99 such rows)" in words


def test_clock_runs_backwards(logs, columns):
    columns["time"][100:] -= 0.5
    words = refusal(logs, columns)
    assert "column 'time', row 100" in words and "runs backwards" in words


@pytest.mark.parametrize("lost", [1, 40])
def test_gap(logs, columns, lost):
    kept = np.r_[0:300, 300 + lost : 2000]
    words = refusal(logs, {name: values[kept] for name, values in columns.items()}, strict=True)
    assert "column 'time', row 300" in words
    assert f"about {lost} samples lost" in words and "split the trial" in words


def test_jitter(logs, columns):
    columns["time"] += np.random.default_rng(0).normal(0, 1e-4, 2000)
    words = refusal(logs, columns, strict=True)
    assert "column 'time' jitters by 14." in words or "column 'time' jitters by 13." in words, "of two steps of 10 %"


def test_trials_of_two_rates(logs, columns):
    slower = {name: values[::4] for name, values in make_columns(seed=1).items()}
    words = refusal(logs, slower, "b.parquet", strict=True)
    assert "runs at 250 Hz, expected 1000 Hz as the other trials" in words


def test_a_clock_that_starts_late_counts_from_its_first_row(logs, columns):
    columns["time"] += 1_700_000_000.0
    put(logs, "a.parquet", columns)
    trial = read_log_set(logs).trials[0].trajectory
    assert trial.time[0] == 0.0 and trial.duration == pytest.approx(1.999, abs=1e-6)


def test_too_short(logs, columns):
    assert "9 rows, expected at least 10" in refusal(logs, {n: v[:9] for n, v in columns.items()})


@pytest.mark.parametrize("content", [b"", b"PAR1", b"time,joint/hip/position\n0,0\n"])
def test_empty_and_foreign_files(logs, content):
    (logs / "a.parquet").write_bytes(content)
    with pytest.raises(LogError, match=r"a\.parquet: (the file is empty|not a complete Parquet file)"):
        read_log_set(logs)


def test_truncated_file(logs):
    whole = (logs / "a.parquet").read_bytes()
    (logs / "a.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(LogError, match=r"a\.parquet: not a complete Parquet file"):
        read_log_set(logs)


def test_joints_differ_between_trials(logs):
    other = {name.replace("knee", "kneee"): values for name, values in make_columns(seed=1).items()}
    words = refusal(logs, other, "b.parquet")
    assert "no joint 'knee' – did you mean 'kneee'?, which a.parquet has" in words


def test_channels_differ_between_trials(logs):
    other = {k: v for k, v in make_columns(seed=1).items() if not k.endswith("effort")}
    assert "no column 'joint/hip/effort', which a.parquet has" in refusal(logs, other, "b.parquet")


def test_directories(tmp_path):
    with pytest.raises(LogError, match="does not exist"):
        read_log_set(tmp_path / "nowhere")
    with pytest.raises(LogError, match="it is empty"):
        read_log_set(tmp_path)
    (tmp_path / "trial.csv").write_text("time\n")
    with pytest.raises(LogError, match=r"found only \.csv.*bring-your-own-logs"):
        read_log_set(tmp_path)
    with pytest.raises(LogError, match="is a file; expected a directory"):
        read_log_set(tmp_path / "trial.csv")
