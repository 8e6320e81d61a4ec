"""What a shell offers after Tab, and second spellings of options."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import toy_pipeline
from click.shell_completion import ShellComplete
from test_alone import WITH_POSTER

from hqpipe.cli import LazyGroup, run_cli
from hqpipe.stages import STAGES


def offered(table, *words: str, incomplete: str = "") -> list[str]:
    complete = ShellComplete(LazyGroup(table), {}, "hqpipe", "_HQPIPE_COMPLETE")
    return [item.value for item in complete.get_completions(list(words), incomplete)]


def test_commands_and_stages(toy):
    assert {"numbers", "square-up", "report", "run", "status", "blind"} <= set(offered(toy_pipeline.TABLE))
    assert offered(toy_pipeline.TABLE, incomplete="squ") == ["square-up"]
    assert offered(toy_pipeline.TABLE, "run") == ["all"]
    assert offered(toy_pipeline.TABLE, "blind") == ["make", "score"]


@pytest.mark.parametrize("option", ["--from", "--until"])
def test_ends_of_the_chain(toy, option):
    assert offered(WITH_POSTER, "run", "all", option) == ["numbers", "square-up", "report"]
    assert offered(WITH_POSTER, "run", "all", option, incomplete="s") == ["square-up"]


@pytest.mark.parametrize("command", [("run", "all"), ("status",), ("numbers",)])
def test_profiles_of_the_file(toy, monkeypatch, command):
    monkeypatch.chdir(toy.root / "robot")
    assert offered(toy_pipeline.TABLE, *command, "--profile") == ["default", "ci"]
    assert offered(toy_pipeline.TABLE, *command, "--profile", incomplete="c") == ["ci"]


def test_no_profiles_without_a_file_that_can_be_read(toy, tmp_path_factory, monkeypatch):
    toy.edit("seed: 1", "seed: [")
    assert offered(toy_pipeline.TABLE, "status", "--profile") == []
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    assert offered(toy_pipeline.TABLE, "status", "--profile") == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_line_of_the_readme_gives_a_script(shell):
    command = [sys.executable, str(Path(toy_pipeline.__file__))]
    environment = {**os.environ, "_HQPIPE_COMPLETE": f"{shell}_source"}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert "_HQPIPE_COMPLETE" in result.stdout and "Traceback" not in result.stderr


def test_validate_takes_the_onnx_folder_under_either_name(tmp_path, monkeypatch, capfd):
    (tmp_path / "pipeline.yaml").write_bytes(STAGES.template.read_bytes())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    for option in ("--onnx", "--policy"):
        assert run_cli(STAGES, ["validate", option, "mine", "--dry-run"]) == 2
        assert "--onnx mine: the folder is empty" in capfd.readouterr().err
    assert run_cli(STAGES, ["validate", "--onnx", "mine", "--policy", "mine"]) == 2
    assert "--onnx and --policy name the same input: give --onnx alone" in capfd.readouterr().err
    assert run_cli(STAGES, ["validate", "--help"]) == 0
    text = capfd.readouterr().out
    assert "--onnx DIR" in text and "--policy" not in text
