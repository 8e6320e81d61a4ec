"""status, dag, diff, gc, init, doctor."""

from __future__ import annotations

import os

import pytest


def test_status_of_a_fresh_project(toy):
    answer = toy("status", "--json")
    assert answer.code == 3
    assert {stage["state"] for stage in answer.data["stages"]} == {"missing"}
    assert not toy.artifacts.exists()


def test_status_current_then_stale(toy):
    toy("run", "all")
    assert toy("status").code == 0
    toy.edit("offset: 0", "offset: 3")
    answer = toy("status", "--explain")
    assert answer.code == 3
    assert "offset 0.0 → 3.0" in answer.out and "input squares is made again" in answer.out
    assert toy("status", "--json").data["current"] is False


def test_status_points_to_the_profile_that_was_used(toy):
    toy("run", "all", "--profile", "ci")
    answer = toy("status")
    assert answer.code == 3 and "hqpipe status --profile ci" in answer.out
    assert toy("status", "--profile", "ci").code == 0


def test_dag(toy):
    answer = toy("dag", "--json")
    assert [stage["inputs"] for stage in answer.data["stages"]] == [
        {},
        {"numbers": "numbers"},
        {"squares": "squares"},
    ]
    assert "numbers → squares" in toy("dag").out


def test_diff_names_parameter_metric_and_file(toy):
    toy("run", "all")
    old = (toy.artifacts / "squares").readlink().name
    toy("run", "all", "--set", "square_up.offset=1")
    answer = toy("diff", old[:10], "squares", "--json")
    assert answer.code == 0
    assert [reason["text"] for reason in answer.data["causes"]] == ["offset 0.0 → 1.0"]
    assert answer.data["metrics"][0]["name"] == "first"
    assert answer.data["files"] == ["squares.json"]
    assert "made with: the same" in toy("diff", "numbers", "artifacts/numbers").out


@pytest.mark.parametrize("name", ["nothing", "abc", "../.."])
def test_diff_of_something_else(toy, name):
    toy("run", "all")
    answer = toy("diff", "numbers", name)
    assert answer.code == 2 and f"'{name}'" in answer.err


def test_gc_removes_only_what_nothing_current_was_made_from(toy):
    toy("run", "all")
    first = {name: (toy.artifacts / name).readlink().name for name in ("numbers", "squares", "report")}
    toy("run", "all", "--set", "square_up.offset=1")
    listed = toy("gc", "--dry-run", "--json").data["removed"]
    assert {path.rsplit("/", 1)[1] for path in listed} == {first["squares"], first["report"]}
    assert (toy.artifacts / "store" / first["squares"]).exists()
    assert toy("gc").code == 0
    assert not (toy.artifacts / "store" / first["squares"]).exists()
    assert (toy.artifacts / "store" / first["numbers"]).exists()
    assert toy("run", "all", "--set", "square_up.offset=1", "--json").actions["report"] == "kept"


def test_gc_keeps_what_a_current_artifact_was_made_from(toy):
    toy("run", "all")
    numbers = (toy.artifacts / "numbers").readlink().name
    toy("numbers", "--set", "count=1")
    assert toy("gc", "--json").data["removed"] == []
    assert (toy.artifacts / "store" / numbers).exists()


def test_gc_keeps_checkpoints_unless_told(toy):
    scratch = toy.artifacts / "scratch" / ("0" * 64)
    scratch.mkdir(parents=True)
    toy("gc")
    assert scratch.exists()
    toy("gc", "--all")
    assert not scratch.exists()


def test_init_writes_once(toy):
    assert toy("init", "new").code == 0
    assert (toy.root / "new" / "pipeline.yaml").read_bytes() == toy_template()
    answer = toy("init", "new")
    assert answer.code == 2 and "exists" in answer.err


def toy_template() -> bytes:
    from toy_pipeline import TABLE

    return TABLE.template.read_bytes()


def test_doctor_passes_here(toy):
    answer = toy("doctor", "--json")
    assert answer.code == 0, answer.out
    assert {check["name"] for check in answer.data["checks"]} >= {"python", "packages", "store"}


def test_doctor_names_a_store_that_cannot_be_written(toy, monkeypatch):
    def refuse(*arguments, **options):
        raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr("tempfile.TemporaryDirectory", refuse)
    answer = toy("doctor")
    assert answer.code == 1 and "store" in answer.err and "cannot write" in answer.out


def test_gc_keeps_the_last_run_of_every_profile(toy):
    toy("run", "all", "--profile", "ci")
    small = (toy.artifacts / "report").readlink().name
    toy("run", "all")
    assert (toy.artifacts / "report").readlink().name != small
    toy("gc")
    assert (toy.artifacts / "store" / small).exists()
