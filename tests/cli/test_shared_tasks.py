"""Tasks of a stage: shared by its runs, made anew by --force, and removed with the last result that has them."""

from __future__ import annotations

import json


def made(toy) -> list[int]:
    return json.loads((toy.artifacts / "squares" / "made.json").read_text())


def tasks(toy) -> set[str]:
    return {path.name for path in (toy.artifacts / "tasks").iterdir()}


def test_a_run_with_other_parameters_makes_what_is_missing(toy):
    assert toy("run", "all", "--set", "square_up.tasks=2").code == 0
    assert made(toy) == [0, 1]
    assert toy("square-up", "--set", "tasks=4").code == 0
    assert made(toy) == [2, 3]


def test_a_run_that_failed_leaves_its_tasks(toy):
    toy("numbers")
    assert toy("square-up", "--set", "tasks=2", "--set", "fault=late").code == 1
    assert toy("square-up", "--set", "tasks=3").code == 0
    assert made(toy) == [2]


def test_force_makes_all_tasks_again(toy):
    toy("numbers")
    toy("square-up", "--set", "tasks=2")
    assert toy("square-up", "--set", "tasks=2", "--force").code == 0
    assert made(toy) == [0, 1]


def test_gc_removes_tasks_with_the_last_result_that_has_them(toy):
    toy("numbers")
    toy("square-up", "--set", "tasks=3")
    three = tasks(toy)
    toy("square-up", "--set", "tasks=1", "--set", "offset=1")
    (one,) = json.loads((toy.artifacts / "squares" / "manifest.json").read_text())["provenance"]["tasks"]
    listed = {path.rsplit("/", 1)[1] for path in toy("gc", "--json", "--dry-run").data["removed"]}
    assert three - {one} == listed & three and tasks(toy) == three
    assert toy("gc").code == 0
    assert tasks(toy) == {one}


def test_gc_keeps_the_tasks_of_an_unfinished_stage_unless_told(toy):
    toy("numbers")
    toy("square-up", "--set", "tasks=2", "--set", "fault=late")
    toy("gc")
    assert len(tasks(toy)) == 2
    toy("gc", "--all")
    assert not tasks(toy)


def test_a_link_in_the_place_of_the_tasks_is_refused(toy):
    toy("numbers")
    (toy.artifacts / "tasks").symlink_to(toy.root)
    answer = toy("square-up", "--set", "tasks=1")
    assert answer.code == 3 and "tasks is a symbolic link" in answer.err
