"""hqpipe logs check, info and export as a user runs them."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hqpipe.cli import run_cli
from hqpipe.gap.checks.left_out import LeftOut
from hqpipe.gap.effects_shown import EffectShown, LayerEffects
from hqpipe.identify.found import Number
from hqpipe.stages import STAGES
from hqpipe.stages.log_commands.effect_tables import effects_json, print_effects

TIME = np.arange(3000) * 1e-3


def trial(phase: float) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(int(10 * phase))
    columns = {"time": TIME}
    for joint, pace in (("hip", 8.0), ("knee", 13.0)):  # an inertia with damping behind a spring
        tones = [(0.3, pace, phase), (0.1, 2.7 * pace, 0.0)]
        position = sum(a * np.sin(w * TIME + p) for a, w, p in tones)
        velocity = sum(a * w * np.cos(w * TIME + p) for a, w, p in tones)
        acceleration = sum(-a * w**2 * np.sin(w * TIME + p) for a, w, p in tones)
        effort = 5.0 * acceleration + 20.0 * velocity
        columns[f"joint/{joint}/position"] = position + 1e-5 * rng.normal(size=len(TIME))
        columns[f"joint/{joint}/velocity"] = velocity + 1e-3 * rng.normal(size=len(TIME))
        columns[f"joint/{joint}/effort"] = effort + rng.normal(size=len(TIME))
        columns[f"joint/{joint}/position_command"] = position + effort / 20_000.0
    return columns


@pytest.fixture
def logs(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    for i, file in enumerate(("a.parquet", "b.parquet")):
        pq.write_table(pa.table(trial(float(i))), folder / file)
    return folder


def run(capfd, *words):
    """(exit code, standard output, standard error)"""
    capfd.readouterr()
    code = run_cli(STAGES, ["logs", *map(str, words)])
    return code, *capfd.readouterr()


class TestCheck:
    def test_a_sound_set(self, logs, capfd):
        code, out, err = run(capfd, "check", logs, "--strict")
        assert (code, err) == (0, "")
        assert "usable; 2 joints, position control" in out and "finding" not in out
        tables = [line for line in out.splitlines() if str(logs) not in line and not line.startswith("note:")]
        assert max(map(len, tables)) <= 120

    def test_findings_fail_only_when_strict(self, logs, capfd):
        columns = trial(2.0)
        columns["joint/hip/velocity"] *= 180 / np.pi
        pq.write_table(pa.table(columns), logs / "c.parquet")
        code, out, _ = run(capfd, "check", logs)
        assert code == 0 and "usable, with " in out
        (line,) = [line for line in out.splitlines() if line.startswith("finding: joint/hip/velocity is 57")]
        assert line.endswith("(in c.parquet)"), "one line per finding, however long"
        code, _, err = run(capfd, "check", logs, "--strict")
        assert code == 1 and "expected none with --strict" in err

    def test_a_broken_file_is_named_beside_what_the_others_hold(self, logs, capfd):
        (logs / "c.parquet").write_bytes(b"")
        (logs / "d.parquet").write_bytes(b"junk that is no log")
        code, out, err = run(capfd, "check", logs)
        assert code == 1 and err.startswith("error:") and err.count("\n") == 1
        assert "cannot be used as it is; 2 of 4 files cannot be read" in out
        assert "c.parquet: the file is empty" in out and "d.parquet: not a complete Parquet file" in out
        assert "a.parquet, b.parquet" in out and "position_command" in out

    def test_every_file_broken(self, logs, capfd):
        for path in logs.iterdir():
            path.write_bytes(b"")
        code, out, _ = run(capfd, "check", logs)
        assert code == 1 and out.count("refused:") == 2

    def test_json(self, logs, capfd):
        code, out, _ = run(capfd, "check", logs, "--json")
        plain = json.loads(out)
        assert code == 0 and plain["ok"] and plain["verdict"] == "usable" and len(plain["trials"]) == 2
        (logs / "c.parquet").write_bytes(b"")
        code, out, _ = run(capfd, "check", logs, "--json")
        plain = json.loads(out)
        assert code == 1 == plain["exit_code"] and plain["verdict"] == "refused"
        assert [t["file"] for t in plain["trials"] if t["error"]] == ["c.parquet"]
        assert plain["error"]["file"].endswith("c.parquet")

    def test_effects(self, logs, capfd):
        code, out, err = run(capfd, "check", logs, "--effects")
        assert (code, err) == (0, "")
        tables = [
            line for line in out.splitlines() if str(logs) not in line and not line.startswith(("note:", "not sought:"))
        ]
        assert "effect, layer actuator" in out and max(map(len, tables)) <= 120
        code, out, _ = run(capfd, "check", logs, "--effects", "--json")
        plain = json.loads(out)
        assert code == 0 and plain["effects_reason"] is None and plain["verdict"] == "usable"
        rows = {(row["joint"], row["effect"]): row for row in plain["effects"] if row["layer"] == "actuator"}
        delay = rows["hip", "command_delay"]
        assert delay["shows"] and delay["unit"] == "s" and 0.0 < delay["from"] < 3.0 * delay["usual"]
        alike = {tuple(pair["effects"]): pair for pair in plain["pairs"]}
        assert "chamber pressures" in alike["position_bias", "torque_bias"]["experiment"]
        assert "position_bias" in rows["hip", "torque_bias"]["alike"]
        assert any(row["effect"] == "torque_scale" and row["why"] for row in plain["not_sought"])

    def test_effects_of_logs_that_cannot_be_diagnosed(self, logs, capfd):
        (logs / "c.parquet").write_bytes(b"")
        code, out, _ = run(capfd, "check", logs, "--effects")
        assert code == 1 and "effects: nothing can be said: the log set is refused" in out
        for i, path in enumerate(logs.iterdir()):
            columns = {name: each for name, each in trial(float(i)).items() if name.endswith(("time", "position"))}
            pq.write_table(pa.table(columns), path)
        code, out, _ = run(capfd, "check", logs, "--effects", "--json")
        plain = json.loads(out)
        assert plain["effects"] == [] == plain["pairs"] and "no layer can be evaluated" in plain["effects_reason"]

    def test_effects_that_do_not_show_share_a_line_for_each_kind_of_reason(self, capfd):
        def limit(joint, least, share):
            size = None if least is None else Number("limit", "1", least, (least, least))
            return EffectShown(joint, "torque_limit", False, size, None, None, True, share, (), "two supplies")

        shown = (limit("a", None, 0.2), limit("b", 0.5, 0.2), limit("c", 0.4, 0.957), limit("d", None, None))
        print_effects([LayerEffects("servo", ("a", "b", "c", "d"), shown)], None)
        rows = [
            " ".join(line.split()) for line in capfd.readouterr().out.splitlines() if line.startswith("torque_limit")
        ]
        assert rows[:4] == [
            "torque_limit a no: at no size –",
            "torque_limit b no: 0.5 down –",
            "torque_limit c no: base does 95 % –",
            "torque_limit d no: nothing by itself –",
        ]

    def test_what_layers_do_without_is_said(self, capfd):
        trial = LeftOut(("c.parquet",), (), None, "too_short", "too short", "record longer trials")
        joint = LeftOut((), ("hip",), None, "not_judged", "at rest", "")
        layers = [LayerEffects("actuator", left_out=(trial, joint)), LayerEffects("servo", (), (), (), (trial,))]
        layers[1] = replace(layers[1], reason="no joint can be judged")
        print_effects(layers, None)
        assert capfd.readouterr().out.splitlines() == [
            "left out of layer actuator: hip: at rest",
            "layer servo: nothing can be said: no joint can be judged",
            "left out: c.parquet: too short; record longer trials",
        ]
        plain = effects_json(layers, None)
        assert [(row["layer"], row["joint"], row["trials"]) for row in plain["effects_left_out"]] == [
            ("actuator", None, ["c.parquet"]),
            ("actuator", "hip", []),
            ("servo", None, ["c.parquet"]),
        ]
        assert [row["reason"] for row in plain["effects_layers"]] == [None, "no joint can be judged"]

    def test_no_such_folder(self, tmp_path, capfd):
        code, out, err = run(capfd, "check", tmp_path / "absent")
        assert (code, out) == (1, "") and "does not exist" in err


class TestInfo:
    def test_a_line_per_joint_in_every_trial(self, logs, capfd):
        code, out, _ = run(capfd, "info", logs)
        assert code == 0 and out.count("\nhip ") == out.count("\nknee ") == 2
        assert max(map(len, out.splitlines())) <= 100
        assert "▁" in out and "█" in out

    def test_filters(self, logs, capfd):
        code, out, _ = run(capfd, "info", logs, "--joint", "knee", "--trial", "b")
        assert code == 0 and "\nb.parquet:" in out and "\na.parquet:" not in out and "\nhip " not in out
        code, _, err = run(capfd, "info", logs, "--joint", "kneee")
        assert code == 2 and "did you mean 'knee'" in err
        code, _, err = run(capfd, "info", logs, "--trial", "c.parquet", "--json")
        assert code == 2 and "has no trial 'c.parquet'" in err
        _, out, _ = run(capfd, "info", logs, "--joint", "knee", "--trial", "b.parquet", "--json")
        plain = json.loads(out)
        assert list(plain["ranges"]) == ["knee"] and [t["file"] for t in plain["trials"]] == ["b.parquet"]

    def test_ascii_where_there_are_no_blocks(self, logs, monkeypatch):
        stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
        monkeypatch.setattr(sys, "stdout", stream)
        assert run_cli(STAGES, ["logs", "info", str(logs)]) == 0
        stream.seek(0)
        assert "#" in stream.read()


class TestExport:
    @pytest.mark.parametrize("kind", ["csv", "mcap"])
    def test_one_file_per_trial(self, logs, tmp_path, capfd, kind):
        if kind == "mcap":
            pytest.importorskip("rosbags", reason="needs the package rosbags")
        out = tmp_path / "out"
        code, text, _ = run(capfd, "export", logs, "--out", out, "--format", kind, "--json")
        assert code == 0 and json.loads(text)["files"] == [str(out / f"a.{kind}"), str(out / f"b.{kind}")]
        assert sorted(p.name for p in out.iterdir()) == [f"a.{kind}", f"b.{kind}"]
        code, _, err = run(capfd, "export", logs, "--out", out, "--format", kind)
        assert code == 2 and "is there already" in err and "--force" in err
        assert run(capfd, "export", logs, "--out", out, "--format", kind, "--force")[0] == 0

    def test_a_lone_trial_is_whole(self, logs, tmp_path, capfd):
        (logs / "b.parquet").unlink()
        assert run(capfd, "export", logs, "--out", tmp_path / "a.csv", "--format", "csv")[0] == 0
        assert len((tmp_path / "a.csv").read_text().splitlines()) == 1 + len(TIME)

    def test_the_log_set_is_left_alone(self, logs, capfd):
        code, _, err = run(capfd, "export", logs, "--out", logs, "--format", "csv")
        assert code == 2 and "is the log set itself" in err
        assert sorted(p.name for p in logs.iterdir()) == ["a.parquet", "b.parquet"]


def test_help_and_near_matches(capfd):
    code, out, _ = run(capfd, "--help")
    assert code == 0 and all(name in out for name in ("check", "info", "export"))
    code, _, err = run(capfd, "chek")
    assert code == 2 and "did you mean 'check'" in err
