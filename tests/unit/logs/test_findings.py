"""One line per finding, however many trials and joints show it."""

from __future__ import annotations

import numpy as np
from log_builders import make_columns, put

from hqpipe.logs.findings import Finding, grouped, in_trials
from hqpipe.logs.log_set import read_log_set

FILES = [f"{i}.parquet" for i in range(12)]


def test_ten_identical_findings_are_one_line():
    found = [
        Finding("unit", file, "reaches {}: too far", "hip", "position", 9.0 + i) for i, file in enumerate(FILES[:10])
    ]
    assert grouped(found, FILES) == [
        "in 10 of 12 trials (0.parquet, 1.parquet, 2.parquet and 7 more): joint/hip/position reaches 9 … 18: too far"
    ]


def test_joints_are_told_together_and_kinds_apart():
    found = [Finding("sign", "a", "opposes", joint, "effort") for joint in ("hip", "knee")]
    found += [Finding("unit", "a", "opposes", "hip", "effort"), Finding("unit", "a", "opposes", "hip", "position")]
    assert grouped(found, ["a", "b"]) == [
        "a: joint/hip/effort (and of knee) opposes",
        "a: joint/hip/effort opposes",
        "a: joint/hip/position opposes",
    ]


def test_joints_of_other_trials_are_not_told_together():
    """Where each trial moves another joint, none of them stands still in every trial."""
    found = [Finding("constant", f, "is constant", j, "position") for f in "abc" for j in "abcd" if f != j]
    assert grouped(found, list("abc")) == [
        "in 2 of 3 trials (a, c): joint/b/position is constant",
        "in 2 of 3 trials (a, b): joint/c/position is constant",
        "in every trial: joint/d/position is constant",
        "in 2 of 3 trials (b, c): joint/a/position is constant",
    ]


def test_where_it_was_found():
    assert in_trials(["b", "a", "b"], ["a", "b"]) == "in every trial"
    assert in_trials(["b"], ["a", "b"]) == "b"
    assert in_trials(["a", "b"], ["a", "b", "c"]) == "in 2 of 3 trials (a, b)"


def test_a_log_set_tells_each_finding_once(tmp_path):
    logs = tmp_path / "set"
    for i, file in enumerate(FILES):
        columns = make_columns(seed=i)
        if i < 10:
            for name in ("position", "position_command", "velocity"):
                columns[f"joint/hip/{name}"] *= 180.0 / np.pi
        put(logs, file, columns)
    lines = [w for w in read_log_set(logs).warnings if "looks like degrees" in w]
    assert len(lines) == 2, lines  # the position and its command
    assert all(line.startswith("in 10 of 12 trials (0.parquet, ") for line in lines)
