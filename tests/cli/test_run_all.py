"""What `run all` runs, keeps and restores, and what it says about it."""

from __future__ import annotations

import json

import pytest

RAN = {"numbers": "ran", "square-up": "ran", "report": "ran"}
KEPT = {"numbers": "kept", "square-up": "kept", "report": "kept"}


def test_second_run_keeps_everything(toy):
    first = toy("run", "all", "--json")
    assert (first.code, first.actions) == (0, RAN)
    before = toy.snapshot()
    second = toy("run", "all", "--json")
    assert (second.code, second.actions) == (0, KEPT)
    assert toy.snapshot() == before


def test_artifacts_are_links_to_what_was_made(toy):
    toy("run", "all")
    link = toy.artifacts / "squares"
    manifest = json.loads((link / "manifest.json").read_text())
    assert link.is_symlink() and link.readlink().as_posix() == f"store/{manifest['key']}"
    assert json.loads((link / "squares.json").read_text()) == [1, 4, 9, 16]
    params = {"offset": 0.0, "fault": "none", "steps": 0, "tasks": 0, "whole_numbers": False}
    assert manifest["recipe"]["params"] == params
    assert manifest["sources"]["numbers"]["artifact"] == "numbers"
    assert not (toy.artifacts / "scratch" / manifest["key"]).exists()


def test_json_is_alone_on_standard_output(toy):
    answer = toy("run", "all", "--json")
    assert answer.data["error"] is None
    assert "chatter" in answer.err
    assert answer.data["stages"][0]["metrics"]["undefined"] is None


def test_summary_goes_to_standard_error(toy):
    answer = toy("run", "all")
    assert answer.out == ""
    assert "4 numbers" in answer.err


def test_parameter_reruns_the_stage_and_its_readers(toy):
    toy("run", "all")
    answer = toy("run", "all", "--set", "square_up.offset=1", "--json")
    assert answer.actions == {"numbers": "kept", "square-up": "ran", "report": "ran"}
    reason = answer.data["stages"][1]["reasons"][0]
    assert (reason["kind"], reason["name"], reason["old"], reason["new"]) == ("parameter", "offset", 0.0, 1.0)
    assert answer.data["stages"][2]["reasons"][0]["kind"] == "input"


def test_reverted_parameter_restores_the_old_result_without_running(toy):
    toy("run", "all")
    old = (toy.artifacts / "squares").readlink()
    toy("run", "all", "--set", "square_up.offset=1")
    answer = toy("run", "all", "--json")
    assert answer.actions == {"numbers": "kept", "square-up": "restored", "report": "restored"}
    assert (toy.artifacts / "squares").readlink() == old


def test_profile_leaves_the_other_profile_in_the_store(toy):
    toy("run", "all")
    assert toy("run", "all", "--profile", "ci", "--json").actions == RAN
    assert (toy.artifacts / "numbers" / "count.txt").read_text() == "2"
    assert toy("run", "all", "--json").actions == dict.fromkeys(RAN, "restored")


def test_same_content_upstream_does_not_rerun_downstream(toy):
    toy("run", "all")
    answer = toy("run", "all", "--set", "numbers.label=b", "--json")
    assert answer.actions == {"numbers": "ran", "square-up": "kept", "report": "kept"}


def test_a_file_that_nobody_reads_reruns_nobody(toy):
    toy("run", "all")
    answer = toy("run", "all", "--set", "square_up.fault=chatty", "--json")
    assert answer.actions == {"numbers": "kept", "square-up": "ran", "report": "kept"}
    assert (toy.artifacts / "squares" / "note.txt").is_file()
    assert toy("verify").code == 0
    assert toy("report", "--squares", str(toy.artifacts / "squares"), "--json").actions == {"report": "kept"}


def test_seed_of_one_stage_reruns_only_it_and_its_readers(toy):
    toy("run", "all")
    answer = toy("run", "all", "--set", "square_up.seed=3", "--json")
    # The squares do not depend on the seed: same bytes, so the report is kept.
    assert answer.actions == {"numbers": "kept", "square-up": "ran", "report": "kept"}
    assert [reason["kind"] for reason in answer.data["stages"][1]["reasons"]] == ["seed"]


def test_global_seed_reruns_all_but_a_stage_with_its_own(toy):
    toy.edit("report: {}", "report: {seed: 9}")
    toy("run", "all")
    answer = toy("run", "all", "--seed", "5", "--dry-run", "--json")
    kinds = {stage["stage"]: {reason["kind"] for reason in stage["reasons"]} for stage in answer.data["stages"]}
    assert kinds == {"numbers": {"seed"}, "square-up": {"upstream", "seed"}, "report": {"upstream"}}


def test_robot_file_reruns_everything(toy):
    toy("run", "all")
    (toy.root / "robot" / "toy" / "robot.yaml").write_text("mass: 2\n")
    answer = toy("run", "all", "--json")
    assert answer.actions["numbers"] == "ran"
    assert [reason["kind"] for reason in answer.data["stages"][0]["reasons"]] == ["robot"]


def test_workers_are_no_reason(toy):
    toy("run", "all")
    toy.edit("workers: 2", "workers: 1")
    assert toy("run", "all", "--json").actions == KEPT


def test_dry_run_changes_nothing_and_propagates(toy):
    toy("run", "all")
    before = toy.snapshot()
    answer = toy("run", "all", "--set", "numbers.count=5", "--dry-run", "--json")
    assert answer.actions == {"numbers": "run", "square-up": "run", "report": "run"}
    assert toy.snapshot() == before
    table = toy("run", "all", "--set", "numbers.count=5", "--dry-run").out
    assert "count 4 → 5" in table and "input numbers is made again" in table


def test_dry_run_in_a_fresh_project_makes_no_folder(toy):
    assert toy("run", "all", "--dry-run").code == 0
    assert not toy.artifacts.exists()


def test_explain_names_old_and_new(toy):
    toy("run", "all")
    answer = toy("run", "all", "--set", "square_up.offset=2", "--explain")
    assert "square-up: run\n  offset 0.0 → 2.0" in answer.err
    assert "numbers: keep\n  nothing changed" in answer.err


def test_from_and_until(toy):
    answer = toy("run", "all", "--until", "square-up", "--json")
    assert list(answer.actions) == ["numbers", "square-up"]
    # The changed upstream stage is outside the range: its current artifact is taken as it is.
    answer = toy("run", "all", "--from", "report", "--set", "numbers.count=9", "--json")
    assert answer.actions == {"report": "ran"}
    answer = toy("run", "all", "--from", "report", "--until", "numbers")
    assert answer.code == 2 and "comes after" in answer.err


def test_from_without_artifacts_names_what_to_run(toy):
    answer = toy("run", "all", "--from", "report")
    assert answer.code == 2
    assert "hqpipe square-up" in answer.err and "--squares" in answer.err


def test_force_runs_all_and_keeps_the_keys(toy):
    toy("run", "all")
    before = (toy.artifacts / "numbers").readlink()
    answer = toy("run", "all", "--force", "--json")
    assert answer.actions == RAN
    assert (toy.artifacts / "numbers").readlink() == before
    assert "warning" not in answer.err


def test_forced_run_with_other_bytes_warns_and_reruns_the_readers(toy):
    toy.edit("offset: 0", "fault: random")
    toy.edit("report: {}", "report: {limit: 1.0e+30}")
    toy("run", "all")
    answer = toy("square-up", "--force")
    assert answer.code == 0
    assert "square-up did not make the same bytes as before: squares.json" in answer.err
    assert toy("run", "all", "--json").actions == {"numbers": "kept", "square-up": "kept", "report": "ran"}


@pytest.mark.parametrize("arguments", [("run",), ("run", "everything"), ("run", "numbers")])
def test_run_needs_all(toy, arguments):
    answer = toy(*arguments)
    assert answer.code == 2 and "all" in answer.err
