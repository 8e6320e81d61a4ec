"""One stage alone: on current artifacts, on a folder from outside, with its own options."""

from __future__ import annotations

import json

import pytest


@pytest.fixture
def outside(tmp_path):
    folder = tmp_path / "mine"
    (folder / "part").mkdir(parents=True)
    (folder / "part" / "numbers.json").write_text("[7, 8]")
    return folder


def test_missing_input_names_the_artifact_and_the_command(toy):
    answer = toy("square-up")
    assert answer.code == 2
    assert "artifacts/numbers" in answer.err and "`hqpipe numbers`" in answer.err and "--numbers" in answer.err


def test_runs_on_the_current_artifact_as_it_is(toy):
    toy("numbers", "--set", "count=2")
    assert toy("square-up", "--json").actions == {"square-up": "ran"}
    assert json.loads((toy.artifacts / "squares" / "squares.json").read_text()) == [1, 4]


def test_runs_on_a_folder_from_outside(toy, outside):
    answer = toy("square-up", "--numbers", str(outside), "--json")
    assert answer.actions == {"square-up": "ran"}
    manifest = json.loads((toy.artifacts / "squares" / "manifest.json").read_text())
    assert manifest["sources"]["numbers"] == {"artifact": None, "key": None, "path": str(outside)}
    assert toy("square-up", "--numbers", str(outside), "--json").actions == {"square-up": "kept"}
    (outside / "part" / "numbers.json").write_text("[7, 9]")
    assert toy("square-up", "--numbers", str(outside), "--json").actions == {"square-up": "ran"}


def test_artifact_given_by_hand_is_the_same_as_the_current_one(toy):
    toy("numbers")
    toy("square-up")
    answer = toy("square-up", "--numbers", "artifacts/numbers", "--json")
    assert answer.actions == {"square-up": "kept"}


def test_damaged_artifact_given_by_hand_is_refused(toy):
    toy("numbers")
    (toy.artifacts / "numbers" / "count.txt").write_text("9")
    answer = toy("square-up", "--numbers", "artifacts/numbers")
    assert answer.code == 3 and "count.txt" in answer.err


@pytest.mark.parametrize("name", ["absent", "empty"])
def test_folder_that_cannot_be_an_input(toy, name):
    (toy.root / "empty").mkdir()
    answer = toy("square-up", "--numbers", name)
    assert answer.code == 2 and f"--numbers {name}" in answer.err


def test_linked_file_in_an_outside_folder_counts_by_its_content(toy, outside):
    original = outside / "part" / "numbers.json"
    moved = toy.root / "elsewhere.json"
    original.rename(moved)
    original.symlink_to(moved)
    assert toy("square-up", "--numbers", str(outside)).code == 0
    moved.write_text("[1]")
    assert toy("square-up", "--numbers", str(outside), "--json").actions == {"square-up": "ran"}


def test_seed_and_set_belong_to_the_stage(toy):
    toy("numbers", "--seed", "10", "--set", "numbers.count=1")
    assert json.loads((toy.artifacts / "numbers" / "part" / "numbers.json").read_text()) == [10]


def test_flag_is_accepted(toy):
    toy("numbers")
    assert toy("square-up", "--exact", "--json").actions == {"square-up": "ran"}


def test_switch_sets_its_parameter(toy):
    toy("numbers", "--seed", "1")
    toy("square-up", "--set", "offset=0.4", "--whole-numbers")
    assert json.loads((toy.artifacts / "squares" / "squares.json").read_text())[0] == 1
    assert toy("square-up", "--set", "offset=0.4", "--set", "whole_numbers=true", "--json").actions == {
        "square-up": "kept"
    }
    toy("square-up", "--set", "offset=0.4")
    assert json.loads((toy.artifacts / "squares" / "squares.json").read_text())[0] == 1.4


def test_dry_run_and_explain(toy):
    toy("numbers")
    answer = toy("square-up", "--dry-run", "--explain")
    assert answer.code == 0 and "squares has not been made" in answer.err
    assert not (toy.artifacts / "squares").exists()


def test_help_lists_inputs_and_parameters(toy):
    text = toy("numbers", "--help").out
    assert "count" in text and "says nothing about the content" in text
    assert "--numbers DIR" in toy("square-up", "--help").out


def test_folder_in_the_place_of_the_artifact_is_not_overwritten(toy):
    (toy.artifacts / "numbers").mkdir(parents=True)
    for arguments in (["numbers"], ["numbers", "--force"]):
        answer = toy(*arguments)
        assert answer.code == 2 and "move it away" in answer.err


def test_an_option_with_a_value_sets_its_parameter(toy):
    toy("numbers")
    toy("square-up", "--offset", "3", "--json")
    assert json.loads((toy.artifacts / "squares" / "squares.json").read_text())[0] == 4
    assert toy("square-up", "--dry-run", "--set", "offset=3", "--json").data["stages"][0]["action"] == "keep"
    answer = toy("square-up", "--offset", "three")
    assert answer.code == 2 and "error: --offset three: " in answer.err and "give --offset another value" in answer.err
