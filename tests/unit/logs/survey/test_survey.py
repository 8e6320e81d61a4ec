"""The survey of whole log sets: sound ones, refused ones, and real machines without false alarms."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from log_builders import make_columns, put

from hqpipe.errors import LogError
from hqpipe.logs.survey.findings import grouped
from hqpipe.logs.survey.layers import layers
from hqpipe.logs.survey.reading import read
from hqpipe.logs.survey.survey import survey

DATA = Path(__file__).parents[5] / "shared" / "data"


def surveyed(folder):
    return survey(read(folder))


def test_a_sound_set_is_usable(logs):
    found = surveyed(logs)
    assert (found.verdict, found.defects) == ("usable", [])
    assert [t.verdict for t in found.trials] == ["ok", "ok"]
    assert [f.text.partition(":")[0] for f in found.findings] == ["no logset.yaml"], "a note"
    assert [(x.layer, x.mode) for x in found.layers if x.evaluated] == [
        ("actuator", "position"),
        ("joint_motion", None),
        ("sensing", None),
    ]


def test_a_torque_that_vibrates_while_its_joint_slides_is_a_note(tmp_path):
    columns = make_columns(samples=20_000)
    time = columns["time"]
    speed = np.where(time % 2.0 < 1.0, 0.5 * np.sin(np.pi * time), 0.0)
    columns["joint/hip/velocity"], columns["joint/hip/position"] = speed, 1e-3 * np.cumsum(speed)
    columns["joint/hip/effort"] = 40.0 * (np.abs(speed) > 0.02) * np.sin(2.0 * np.pi * 120.0 * time)
    put(tmp_path / "logs", "strokes.parquet", columns)
    (told,) = [f for f in surveyed(tmp_path / "logs").findings if "vibrates" in f.text]
    assert told.is_note and told.joints == ("hip",)
    assert told.text.startswith("joint/hip/effort: the torque vibrates by 39.8 N·m at 120 Hz while the joint slides")


def test_the_json_has_its_keys_and_no_numpy(logs):
    plain = surveyed(logs).to_json()
    assert json.loads(json.dumps(plain)) == plain
    assert set(plain) == {
        *(
            "path",
            "verdict",
            "log_set",
            "trials",
            "channels",
            "excitation",
            "layers",
            "other_columns",
            "findings",
            "notes",
        )
    }
    assert set(plain["trials"][0]) == {
        *("file", "split", "seconds", "samples", "rate_hz", "clock", "lost", "stretches", "missing", "verdict", "error")
    }
    assert set(plain["trials"][0]["clock"]) == {"verdict", "jitter_rms", "jitter_max", "gaps"}
    assert set(plain["channels"][0]) == {
        *("joint", "channel", "file", "unit", "min", "max", "resolution", "noise", "held_samples", "limit"),
        *("verdict", "flags"),
    }
    assert len(plain["channels"]) == 2 * 2 * 4


def test_of_a_refused_set_each_file_is_judged_on_its_own(logs):
    (logs / "c.parquet").write_bytes(b"PAR1 not a log")
    late = make_columns(seed=2)
    late["time"] = np.where(np.arange(2000) > 900, late["time"] + 0.5, late["time"])
    put(logs, "d.parquet", late)
    found = surveyed(logs)
    assert found.verdict == "refused" and isinstance(found.reading.refused, LogError)
    assert {t.file: t.verdict for t in found.trials} == {
        "a.parquet": "ok",
        "b.parquet": "ok",
        "c.parquet": "refused",
        "d.parquet": "gaps",
    }
    errors = {t.file: t.error for t in found.trials if t.error}
    assert list(errors) == ["c.parquet"] and "not a complete Parquet file" in errors["c.parquet"]
    assert {c.file for c in found.channels} == {"a.parquet", "b.parquet", "d.parquet"}
    assert next(t for t in found.trials if t.file == "d.parquet").stretches == 2


def test_trials_with_different_joints_are_still_judged(logs):
    other = {name.replace("knee", "ankle"): values for name, values in make_columns(seed=2).items()}
    put(logs, "c.parquet", other)
    found = surveyed(logs)
    assert found.verdict == "refused" and "no joint 'knee'" in str(found.reading.refused)
    assert [t.verdict for t in found.trials] == ["ok"] * 3
    assert {c.joint for c in found.channels} == {"hip", "knee", "ankle"}


def test_a_broken_manifest_hides_no_trial(logs):
    (logs / "logset.yaml").write_text("format: [")
    found = surveyed(logs)
    assert found.verdict == "refused" and [t.verdict for t in found.trials] == ["ok", "ok"]


def test_a_set_that_only_holds_out_is_judged_with_its_splits(logs):
    (logs / "logset.yaml").write_text("format: hqpipe-log/1\ntrials:\n  - {file: a.parquet, split: heldout}\n")
    found = surveyed(logs)
    assert found.verdict == "refused" and [(t.file, t.split) for t in found.trials] == [("a.parquet", "heldout")]


def test_a_folder_without_trials_is_an_error(tmp_path):
    with pytest.raises(LogError, match="no trial in it"):
        read(tmp_path)
    with pytest.raises(LogError, match="does not exist"):
        read(tmp_path / "absent")


def test_defects_are_found_once(logs):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1), ("c.parquet", 2)):
        columns = make_columns(seed=seed)
        columns["joint/hip/velocity"] *= 180 / np.pi
        columns["joint/knee/position_command"] = np.full(2000, 0.1)
        put(logs, file, columns)
    found = surveyed(logs)
    units = [f for f in found.defects if "degrees" in f.text]
    assert [(f.files, f.joints) for f in units] == [(("a.parquet", "b.parquet", "c.parquet"), ("hip",))]
    assert "in all 3 files" in units[0].line(3)
    assert found.verdict == "usable_with_findings"


@pytest.mark.parametrize(("dropped", "asked"), [(("effort",), "servo"), (("position_command",), "joint_motion")])
def test_without_torque_or_command_another_layer_is_asked(logs, dropped, asked):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        columns = make_columns(seed=seed)
        put(logs, file, {name: values for name, values in columns.items() if not name.endswith(dropped)})
    found = surveyed(logs)
    assert found.verdict == "usable" and asked in {x.layer for x in found.layers if x.evaluated}


@pytest.mark.parametrize(("base", "asked"), [(None, False), ("floating", False), ("fixed", True)])
def test_forces_at_the_feet_tell_that_the_base_moves_unless_the_log_says_otherwise(base, asked):
    found = layers(["position", "velocity", "effort"], None, extra=("foot/LF/force/z",), base=base)
    assert [x.evaluated for x in found if x.layer == "joint_motion"] == [asked]


def test_without_effort_and_command_nothing_can_be_diagnosed(logs):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        columns = make_columns(seed=seed)
        put(logs, file, {n: values for n, values in columns.items() if not n.endswith(("effort", "position_command"))})
    found = surveyed(logs)
    assert found.verdict == "not_diagnosable"
    (finding,) = found.defects
    assert finding.text.startswith(
        "hqpipe diagnose names no cause in these logs: the actuator layer needs joint/<name>/position_command and "
        "joint/<name>/effort"
    )


def test_warnings_that_differ_in_file_joint_and_figures_are_one():
    files = [f"{i:02}.parquet" for i in range(12)]
    warnings = [f"{file}: joint/{joint}/position reaches {i}.5" for i, file in enumerate(files[:10]) for joint in "ab"]
    both = grouped([*warnings, "11.parquet: joint/a/effort reaches 2"], files)
    assert [(len(f.files), f.joints) for f in both] == [(10, ("a", "b")), (1, ("a",))]
    assert both[0].line(12) == "joint/a/position reaches 0.5 (also b; in 10 of 12 files)"
    assert both[1].line(12) == "joint/a/effort reaches 2 (in 11.parquet)"


@pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data, the logs of five real machines")
@pytest.mark.parametrize(
    ("name", "verdict", "defects", "notes"),
    [
        ("emps", "usable", [], ["no velocity"]),
        ("go2", "usable", [], ["no velocity", "is a staircase"]),
        ("xl330", "usable", [], []),
        ("cranfield_ref", "usable_with_findings", ["lost the sign"], ["no velocity"]),
        ("cranfield_lube1", "usable_with_findings", ["lost the sign"], ["no velocity"]),
        ("so101", "usable_with_findings", ["lost the sign", *["is constant"] * 4], ["is a staircase"]),
    ],
)
def test_real_machines_raise_no_false_alarm(name, verdict, defects, notes):
    found = surveyed(DATA / name)
    assert found.verdict == verdict and {t.verdict for t in found.trials} == {"ok"}
    for words, lines in ((defects, found.defects), (notes, [f for f in found.findings if f.is_note])):
        assert len(words) == len(lines) and all(w in f.text for w, f in zip(words, lines, strict=True)), lines
