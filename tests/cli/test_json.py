"""Under --json every command ends with one object on standard output: ok, exit_code, error, and its own keys."""

from __future__ import annotations

import fcntl
import json
import os
import sys

import pytest
import toy_pipeline

ERROR = {"message", "file", "field", "fix", "exit_code"}


def envelope(answer) -> dict:
    """The one document on standard output, checked for what all of them have."""
    data = json.loads(answer.out)
    assert data["exit_code"] == answer.code and data["ok"] is (answer.code == 0)
    assert list(data)[:3] == ["ok", "exit_code", "error"]
    if answer.code == 0:
        assert data["error"] is None
    else:
        assert set(data["error"]) == ERROR and data["error"]["exit_code"] == answer.code
        assert data["error"]["message"] and data["error"]["fix"]
    return data


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (("nothing", "--json"), None),
        (("--json",), "--json"),
        (("--json", "status"), "--json"),
        (("run", "--json"), "all"),
        (("run", "everything", "--json"), "all"),
        (("run", "all", "--no-such", "--json"), "--no-such"),
        (("run", "all", "--seed", "x", "--json"), "--seed"),
        (("run", "all", "--seed", "-1", "--json"), "--seed"),
        (("run", "all", "--json=yes"), "--json"),
        (("run", "all", "--from", "nothing", "--json"), "--from"),
        (("run", "all", "--profile", "nothing", "--json"), "--profile"),
        (("run", "all", "--set", "numbers.count=x", "--json"), "numbers.count"),
        (("run", "all", "--set", "numbers", "--json"), "--set"),
        (("numbers", "--set", "nothing=1", "--json"), "numbers.nothing"),
        (("blind", "make", "--json"), "--out"),
        (("blind", "score", "nothing", "--json"), "DIR"),
        (("diff", "numbers", "--json"), "B"),
        (("diff", "numbers", "x" * 300, "--json"), "B"),
        (("square-up", "--numbers", "x" * 5000, "--json"), "--numbers"),
        (("init", "x" * 300, "--json"), "DIR"),
    ],
)
def test_wrong_usage(toy, arguments, field):
    answer = toy(*arguments)
    assert answer.code == 2 and envelope(answer)["error"]["field"] == field
    assert answer.err and "Traceback" not in answer.err


def test_wrong_file(toy):
    toy.edit("count: 4", "count: many")
    for arguments in (("run", "all"), ("status",), ("numbers",), ("run", "all", "--dry-run")):
        answer = toy(*arguments, "--json")
        error = envelope(answer)["error"]
        assert answer.code == 2
        assert (error["file"], error["field"]) == (str(toy.root / "pipeline.yaml"), "stages.numbers.count")


def test_outside_a_project(toy, tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    for command in ("status", "verify", "gc"):
        answer = toy(command, "--json")
        assert answer.code == 2 and "hqpipe init DIR" in envelope(answer)["error"]["fix"]


def test_every_command_when_all_is_well(toy):
    assert envelope(toy("init", "new", "--json"))["path"] == "new/pipeline.yaml"
    data = envelope(toy("run", "all", "--json"))
    assert data["profile"] == "default" and [stage["action"] for stage in data["stages"]] == ["ran"] * 3
    assert envelope(toy("run", "all", "--dry-run", "--json"))["dry_run"] is True
    assert envelope(toy("status", "--json"))["current"] is True
    assert len(envelope(toy("dag", "--json"))["stages"]) == 3
    assert len(envelope(toy("verify", "--json"))["artifacts"]) == 3
    assert envelope(toy("diff", "numbers", "numbers", "--json"))["causes"] == []
    assert envelope(toy("gc", "--json"))["removed"] == []
    assert envelope(toy("doctor", "--json"))["checks"]


def test_a_failed_stage_is_told_beside_those_that_ran(toy):
    answer = toy("run", "all", "--set", "square_up.fault=unexpected", "--json")
    data = envelope(answer)
    assert answer.code == 1 and answer.actions == {"numbers": "ran"} and data["profile"] == "default"
    assert "ZeroDivisionError" in data["error"]["message"] and "--traceback" in data["error"]["fix"]


def test_a_missed_gate(toy):
    toy.edit("report: {}", "report: {limit: 10}")
    answer = toy("run", "all", "--json")
    assert answer.code == 4 and answer.actions["report"] == "ran"
    assert "16.0 above 10.0" in json.loads(answer.out)["error"]["message"]


def test_what_is_not_current(toy):
    answer = toy("status", "--json")
    data = envelope(answer)
    assert answer.code == 3 and data["current"] is False and len(data["stages"]) == 3
    assert "numbers (missing)" in data["error"]["message"]


def test_damage(toy):
    toy("run", "all")
    path = toy.artifacts / "squares" / "squares.json"
    path.chmod(0o644)
    path.write_text("[]")
    data = envelope(toy("verify", "--json"))
    assert data["exit_code"] == 3 and data["artifacts"][1]["problems"]
    assert data["error"]["file"] == "artifacts/squares/squares.json"
    for arguments in (("run", "all"), ("run", "all", "--dry-run"), ("report",)):
        answer = toy(*arguments, "--json")
        error = json.loads(answer.out)["error"]
        assert answer.code == 3 and "squares.json" in error["message"]
    assert envelope(toy("status", "--json"))["exit_code"] == 3


def test_locked(toy):
    toy("numbers")
    (lock,) = [path for path in toy.artifacts.iterdir() if "lock" in path.name and "holder" not in path.name]
    with lock.open("a") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        answer = toy("run", "all", "--json")
    assert answer.code == 5 and json.loads(answer.out)["stages"] == []


def test_interrupted(toy):
    answer = toy("run", "all", "--set", "square_up.fault=interrupt", "--json")
    data = envelope(answer)
    assert answer.code == 130 and [stage["stage"] for stage in data["stages"]] == ["numbers"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError(), "not enough memory"),
        (RecursionError("deep"), "nested too deeply"),
        (ZeroDivisionError("zero"), "ZeroDivisionError: zero"),
    ],
)
def test_errors_that_nobody_meant(toy, monkeypatch, error, words):
    def fail(self):
        raise error

    monkeypatch.setattr(toy_pipeline.TABLE["numbers"].__class__, "load_params", fail)
    answer = toy("status", "--json")
    data = json.loads(answer.out)
    assert answer.code == 1 and data["ok"] is False and words in data["error"]["message"]


def test_a_library_that_ends_the_process(toy, monkeypatch):
    monkeypatch.setattr(toy_pipeline.TABLE["numbers"].__class__, "load_params", lambda self: sys.exit("gone"))
    data = json.loads(toy("status", "--json").out)
    assert (data["ok"], data["exit_code"]) == (False, 1)


def test_no_doctor_can_help(toy, monkeypatch):
    def refuse(*arguments, **options):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr("tempfile.TemporaryDirectory", refuse)
    data = envelope(toy("doctor", "--json"))
    assert data["exit_code"] == 1 and any(not check["ok"] for check in data["checks"])


@pytest.mark.parametrize("arguments", [("status", "--help"), ("numbers", "--help"), ("run", "--help")])
def test_help_stays_text(toy, arguments):
    plain, asked = toy(*arguments), toy(*arguments, "--json")
    assert plain.out and asked.code == 0 and asked.out == plain.out


def test_without_the_option_nothing_is_json(toy):
    assert toy("status").out.startswith("artifact")
    assert toy("nothing").out == ""


def test_a_reader_that_has_gone_is_no_traceback(toy):
    import subprocess
    from pathlib import Path

    program = [sys.executable, str(Path(toy_pipeline.__file__)), "dag", "--json"]
    process = subprocess.Popen(program, cwd=toy.root, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    error = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait(60) == 141 and "Traceback" not in error and "Exception" not in error
