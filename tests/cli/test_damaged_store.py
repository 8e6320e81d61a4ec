"""Damage of the store beyond a changed byte: every look at it ends with code 3, the file and what to do."""

from __future__ import annotations

import json
import os
import shutil

import pytest

from hqpipe.pipeline.hashing import data_hash

LOOKS = (
    ["verify"],
    ["status"],
    ["gc"],
    ["gc", "--dry-run"],
    ["run", "all", "--dry-run"],
    ["diff", "squares", "numbers"],
)


@pytest.fixture
def made(toy):
    toy("run", "all")
    return toy


def told(answer) -> str:
    """All that was said, without the line breaks of a table."""
    return "".join((answer.err + answer.out).split())


def resealed(data: dict) -> str:
    """A record whose digest fits whatever it says."""
    body = {name: value for name, value in data.items() if name != "digest"}
    return json.dumps({**body, "digest": data_hash(body)})


def change_record(made, *names: str, value) -> None:
    """Set one field of the record of squares, and seal it anew."""
    path = made.artifacts / "squares" / "manifest.json"
    data = json.loads(path.read_text())
    inner = data
    for name in names[:-1]:
        inner = inner[name]
    if value is Ellipsis:
        del inner[names[-1]]
    else:
        inner[names[-1]] = value
    path.write_text(resealed(data))


def nested(depth: int) -> dict:
    value: dict = {}
    for _ in range(depth):
        value = {"a": value}
    return value


WRONG = {
    "params is a list": (("recipe", "params"), []),
    "seed is text": (("recipe", "seed"), "1"),
    "version is a truth value": (("recipe", "version"), True),
    "an input is no hash": (("recipe", "inputs"), {"numbers": "0" * 63}),
    "robot is no hash": (("recipe", "robot"), "toy"),
    "recipe is null": (("recipe",), None),
    "outputs is text": (("outputs",), "squares.json"),
    "an output is no hash": (("outputs",), {"squares.json": "x"}),
    "an output in capitals": (("outputs",), {"squares.json": "A" * 64}),
    "metrics is null": (("metrics",), None),
    "a gate without failures": (("metrics", "gate"), {"passed": False}),
    "a gate whose failures are numbers": (("metrics", "gate"), {"passed": False, "failures": [1]}),
    "a gate that is a number": (("metrics", "gate"), 1),
    "provenance is a list": (("provenance",), []),
    "no created": (("provenance", "created"), ...),
    "no profile": (("provenance", "profile"), ...),
    "created is a number": (("provenance", "created"), 10**400),
    "wall time is text": (("provenance", "wall_time_s"), "long"),
    "sources is a list": (("sources",), [1]),
    "a source is null": (("sources",), {"numbers": None}),
    "a source of nowhere": (("sources",), {"numbers": {"artifact": None, "key": None, "path": None}}),
    "a source that leads out": (("sources", "numbers", "key"), "../../.."),
    "a source that is no input": (("sources",), {"other": {"artifact": None, "key": None, "path": "x"}}),
    "nested 300 deep": (("metrics",), nested(300)),
}


@pytest.mark.parametrize("command", LOOKS, ids=" ".join)
@pytest.mark.parametrize("wrong", WRONG)
def test_record_with_a_wrong_field(made, wrong, command):
    names, value = WRONG[wrong]
    change_record(made, *names, value=value)
    answer = made(*command)
    assert answer.code == 3, answer.err
    assert "manifest.json" in told(answer) and "--force" in told(answer) and "Error" not in told(answer)


UNREADABLE = {
    "nested 10,000 deep": '{"a":' * 10_000 + "1" + "}" * 10_000,
    "nested lists": "[" * 100_000,
    "a number of 10,000 digits": '{"format": "hqpipe-artifact/1", "digest": ' + "9" * 10_000 + "}",
    "an infinite number": '{"format": "hqpipe-artifact/1", "digest": "", "metrics": 1e400}',
    "half a character": '{"format": "hqpipe-artifact/1", "digest": "\\ud800"}',
    "empty": "",
}


@pytest.mark.parametrize("command", LOOKS, ids=" ".join)
@pytest.mark.parametrize("text", UNREADABLE)
def test_record_that_cannot_be_read(made, text, command):
    (made.artifacts / "squares" / "manifest.json").write_text(UNREADABLE[text])
    answer = made(*command)
    assert answer.code == 3, answer.err
    assert "manifest.json" in told(answer) and "Error" not in answer.err


@pytest.mark.parametrize("command", LOOKS, ids=" ".join)
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_record_that_is_no_file(made, kind, command):
    path = made.artifacts / "squares" / "manifest.json"
    path.rename(made.root / "elsewhere.json")
    if kind == "link":
        path.symlink_to(made.root / "elsewhere.json")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.mkdir()
    answer = made(*command)
    assert answer.code == 3 and "manifest.json" in told(answer)


def test_verify_finds_a_link_to_a_result_that_is_gone(made):
    shutil.rmtree((made.artifacts / "squares").resolve())
    answer = made("verify")
    assert answer.code == 3
    assert "artifacts/squares" in answer.err and "gone" in answer.err and "hqpipe square-up" in answer.err
    assert made("diff", "squares", "numbers").code == 3


@pytest.mark.parametrize("command", LOOKS, ids=" ".join)
def test_store_entry_that_is_a_link(made, command):
    entry = (made.artifacts / "squares").resolve()
    entry.rename(made.root / "outside")
    entry.symlink_to(made.root / "outside")
    answer = made(*command)
    assert answer.code == 3 and entry.name[:12] in told(answer)
    assert (made.root / "outside" / "squares.json").exists()


def test_force_replaces_a_store_entry_that_is_a_link_and_leaves_its_target(made):
    entry = (made.artifacts / "squares").resolve()
    entry.rename(made.root / "outside")
    entry.symlink_to(made.root / "outside")
    assert made("square-up", "--force").code == 0
    assert not entry.is_symlink() and made("verify").code == 0
    assert (made.root / "outside" / "squares.json").exists()


def test_result_under_the_key_of_another(made):
    made("run", "all", "--set", "square_up.offset=1")
    keys = [path for path in (made.artifacts / "store").iterdir() if (path / "squares.json").exists()]
    current = (made.artifacts / "squares").resolve()
    (other,) = set(keys) - {current}
    shutil.rmtree(other)
    shutil.copytree(current, other)
    answer = made("run", "all")
    assert answer.code == 3 and "another result" in answer.err


def test_link_to_the_result_of_another_stage(made):
    numbers = (made.artifacts / "numbers").readlink()
    (made.artifacts / "squares").unlink()
    (made.artifacts / "squares").symlink_to(numbers)
    for command in (["verify"], ["status"], ["run", "all"], ["report"]):
        answer = made(*command)
        assert answer.code == 3 and "resultofnumbers" in told(answer) and "hqpipesquare-up" in told(answer)
    assert made("square-up", "--force").code == 0 and made("verify").code == 0


@pytest.mark.parametrize("command", LOOKS, ids=" ".join)
@pytest.mark.parametrize("name", ["store", "scratch"])
def test_store_or_scratch_that_is_a_link(made, name, command):
    (made.artifacts / name).rename(made.root / "outside")
    (made.artifacts / name).symlink_to(made.root / "outside")
    answer = made(*command)
    assert answer.code == 3 and f"artifacts/{name}" in answer.err and "symbolic link" in answer.err


@pytest.mark.parametrize("name", [".lock", ".lock-holder.json"])
def test_links_in_place_of_the_lock_are_not_followed(made, name):
    (made.root / "precious").write_text("precious")
    (made.artifacts / name).unlink(missing_ok=True)
    (made.artifacts / name).symlink_to(made.root / "precious")
    answer = made("gc")
    assert answer.code == (3 if name == ".lock" else 0)
    assert name != ".lock" or "artifacts/.lock" in answer.err
    assert (made.root / "precious").read_text() == "precious"


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_something_else_in_place_of_the_lock(made, kind):
    (made.artifacts / ".lock").unlink()
    (os.mkdir if kind == "folder" else os.mkfifo)(made.artifacts / ".lock")
    answer = made("run", "all")
    assert answer.code == 3 and "artifacts/.lock" in answer.err and "remove it" in answer.err


@pytest.mark.parametrize(
    "place", ["../elsewhere", "/tmp/hqpipe-elsewhere", "inside/../../elsewhere", "link/artifacts", "."]
)
@pytest.mark.parametrize("command", [["run", "all"], ["gc"], ["status"]], ids=" ".join)
def test_artifacts_outside_the_project_are_refused(toy, place, command, tmp_path_factory):
    (toy.root / "link").symlink_to(tmp_path_factory.mktemp("elsewhere"))
    toy.edit("workers: 2", f"workers: 2\nartifacts: {place}")
    answer = toy(*command)
    assert answer.code == 2
    assert "pipeline.yaml: artifacts: " in answer.err and place in answer.err and "inside the project" in answer.err


@pytest.mark.parametrize("command", [["run", "all"], ["gc"], ["status"], ["verify"]], ids=" ".join)
def test_artifacts_that_is_a_file(toy, command):
    (toy.root / "artifacts").write_text("")
    answer = toy(*command)
    assert answer.code == 2 and "artifacts" in answer.err and "expected a folder" in answer.err


@pytest.mark.parametrize("command", [["verify"], ["status"], ["run", "all", "--dry-run"]], ids=" ".join)
def test_pipe_among_the_files_of_a_result(made, command):
    os.mkfifo(made.artifacts / "squares" / "pipe")
    answer = made(*command)
    assert answer.code == 3 and "/pipe" in told(answer)


@pytest.mark.parametrize("kind", ["file", "folder", "pipe"])
def test_something_else_in_place_of_an_artifact(made, kind):
    link = made.artifacts / "squares"
    link.unlink()
    {"file": link.touch, "folder": link.mkdir, "pipe": lambda: os.mkfifo(link)}[kind]()
    for command in (["verify"], ["status"], ["run", "all"]):
        answer = made(*command)
        assert answer.code in (2, 3) and "artifacts/squares" in answer.err and "move it away" in answer.err


def test_folder_in_place_of_a_file_of_a_result(made):
    path = made.artifacts / "squares" / "squares.json"
    path.unlink()
    path.mkdir()
    answer = made("verify")
    assert answer.code == 3 and "squares/squares.json" in answer.err


def test_file_in_place_of_a_store_entry(made):
    entry = (made.artifacts / "squares").resolve()
    shutil.rmtree(entry)
    entry.write_text("")
    for command in LOOKS:
        answer = made(*command)
        assert answer.code == 3 and entry.name[:12] in told(answer)
    assert made("square-up", "--force").code == 0
    assert made("verify").code == 0


def test_gc_removes_what_has_odd_permissions_and_what_is_no_folder(made):
    made("run", "all", "--set", "square_up.offset=1")
    for entry in (made.artifacts / "store").iterdir():
        entry.chmod(0o500)
    (made.artifacts / "scratch").mkdir(exist_ok=True)
    (made.artifacts / "scratch" / "note.txt").write_text("not ours")
    assert made("gc", "--all").code == 0
    assert not list((made.artifacts / "scratch").iterdir())
    assert len(list((made.artifacts / "store").iterdir())) == 3
