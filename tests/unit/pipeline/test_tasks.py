"""Tasks: what a stage has made once is found again by what decides it, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from hqpipe.pipeline.tasks import Task, Tasks

COMMON = {"stage": "compare", "version": 5, "robot": "r"}


def make(task: Task, text: str = "result") -> None:
    folder = task.begin()
    (folder / "result.txt").write_text(text)
    task.finish(folder)


def test_a_task_is_known_by_what_decides_it(tmp_path):
    tasks = Tasks(tmp_path, COMMON)
    task = tasks.find(seed=1, training={"steps": 80, "envs": 4})
    assert not task.is_done()
    make(task)
    again = Tasks(tmp_path, COMMON).find(training={"envs": 4, "steps": 80}, seed=1)
    assert again == task and again.is_done() and (again.files / "result.txt").read_text() == "result"
    others = [tasks.find(seed=2, training={"steps": 80, "envs": 4}), tasks.find(seed=1)]
    others += [
        Tasks(tmp_path, {**COMMON, name: "other"}).find(seed=1, training={"steps": 80, "envs": 4}) for name in COMMON
    ]
    assert len({task.key, *(other.key for other in others)}) == 6
    assert not any(other.is_done() for other in others)


def test_checkpoints_go_when_the_task_is_finished(tmp_path):
    task = Tasks(tmp_path, COMMON).find(seed=1)
    task.scratch.mkdir(parents=True)
    assert not task.is_done() and task.scratch.is_dir()
    make(task)
    assert not task.scratch.exists()


@pytest.mark.parametrize("harm", ["changed", "missing", "added", "half written"])
def test_damage_is_found_and_said(tmp_path, capsys, harm):
    task = Tasks(tmp_path, COMMON).find(seed=1)
    make(task)
    path = task.files / "result.txt"
    if harm == "half written":
        (task.files / "SHA256SUMS").unlink()
    else:
        {"changed": path.write_text, "missing": lambda _: path.unlink(), "added": path.with_name("more").write_text}[
            harm
        ]("x")
    assert not task.is_done()
    assert f"warning: {task.files} is damaged" in capsys.readouterr().err
    make(task)
    assert task.is_done()


def test_a_fresh_run_finds_only_what_it_made_itself(tmp_path):
    make(Tasks(tmp_path, COMMON).find(seed=1))
    fresh = Tasks(tmp_path, COMMON, fresh=True)
    assert not fresh.find(seed=1).is_done()
    make(fresh.find(seed=1), "anew")
    assert fresh.find(seed=1).is_done()
    assert fresh.used == [fresh.find(seed=1).key]


def test_what_a_kill_left_is_removed(tmp_path):
    task = Tasks(tmp_path, COMMON).find(seed=1)
    left: Path = task.begin()
    (left / "half.txt").write_text("half")
    assert not task.is_done() and not left.exists()
