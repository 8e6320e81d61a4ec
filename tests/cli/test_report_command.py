"""`hqpipe report` on the command line: listed apart from the chain, with its inputs and what it lacks."""

from __future__ import annotations

import pytest

from hqpipe.cli import run_cli
from hqpipe.stages import STAGES


@pytest.fixture
def hqpipe(tmp_path, monkeypatch, capfd):
    (tmp_path / "pipeline.yaml").write_bytes(STAGES.template.read_bytes())
    monkeypatch.chdir(tmp_path)

    def command(*arguments: str) -> tuple[int, str, str]:
        code = run_cli(STAGES, arguments)
        return code, *capfd.readouterr()

    return command


def test_it_is_listed_with_the_stages_that_run_alone(hqpipe):
    text = hqpipe("--help")[1]
    assert text.index("Stages that run alone") < text.index("report  ") < text.index("Commands")


def test_its_help_names_every_folder_and_parameter(hqpipe):
    code, text, _ = hqpipe("report", "--help")
    assert code == 0
    for name in ("--onnx", "--diagnosis", "--validation", "shown_seconds", "frame_rate", "slow motion"):
        assert name in text


def test_it_needs_an_exported_policy_and_nothing_else(hqpipe):
    code, _, text = hqpipe("report")
    assert code == 2 and "artifacts/onnx, which has not been made: run `hqpipe export`" in text


def test_the_chain_goes_without_it(hqpipe):
    _, text, _ = hqpipe("run", "all", "--dry-run")
    assert "validate" in text and "report" not in text
    assert "→ report (alone)" in hqpipe("dag")[1]
