"""Looking at the artifacts while another process changes them: an answer or code 3, and never a crash."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest
from toy_pipeline import TABLE

from hqpipe.cli import run_cli

sys.path.append(str(Path(__file__).parents[1]))
from file_operations import each_interference


def remove_result(toy) -> None:
    shutil.rmtree((toy.artifacts / "squares").resolve(), ignore_errors=True)


def remove_a_file(toy) -> None:
    (toy.artifacts / "squares" / "squares.json").unlink(missing_ok=True)


def point_elsewhere(toy) -> None:
    key = (toy.artifacts / "numbers").readlink()
    os.symlink(key, toy.artifacts / "new")
    os.replace(toy.artifacts / "new", toy.artifacts / "squares")


@pytest.mark.parametrize("interfere", [remove_result, remove_a_file, point_elsewhere])
@pytest.mark.parametrize(
    "command",
    [["status"], ["verify"], ["gc", "--dry-run"], ["diff", "squares", "numbers"], ["run", "all", "--dry-run"]],
    ids=" ".join,
)
def test_a_reader_beside_a_writer(toy, command, interfere):
    toy("run", "all")
    for used in (["status"], ["diff", "squares", "numbers"]):  # what they import is then in memory
        toy(*used)
    original = toy.root / "original"
    shutil.copytree(toy.artifacts, original, symlinks=True)

    def prepare() -> None:
        shutil.rmtree(toy.artifacts)
        shutil.copytree(original, toy.artifacts, symlinks=True)

    def work() -> int:
        code = run_cli(TABLE, command)
        sys.stdout.flush()
        sys.stderr.flush()
        return code

    toy.capture.readouterr()
    codes = list(each_interference(work, prepare, lambda: interfere(toy), toy.artifacts))
    out, err = toy.capture.readouterr()
    assert set(codes) <= {0, 2, 3}, err
    assert "Error" not in err and "Traceback" not in err
    assert len(codes) >= 2
