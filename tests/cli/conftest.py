from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import pytest
from toy_pipeline import PIPELINE_YAML, TABLE

from hqpipe.cli import ENVIRONMENT, run_cli


@dataclass
class Answer:
    code: int
    out: str
    err: str

    @property
    def data(self) -> dict:
        return json.loads(self.out)

    @property
    def actions(self) -> dict[str, str]:
        return {stage["stage"]: stage["action"] for stage in self.data["stages"]}


@dataclass
class Toy:
    """A project with the toy stages in a folder of its own."""

    root: Path
    capture: pytest.CaptureFixture

    @property
    def artifacts(self) -> Path:
        return self.root / "artifacts"

    def __call__(self, *arguments: str) -> Answer:
        """Run ``hqpipe`` with these arguments."""
        self.capture.readouterr()
        code = run_cli(TABLE, arguments)
        out, err = self.capture.readouterr()
        return Answer(code, out, err)

    def edit(self, old: str, new: str) -> None:
        """Replace text in pipeline.yaml."""
        path = self.root / "pipeline.yaml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    def snapshot(self) -> dict[str, bytes | str]:
        """Every file and link of the project."""
        return {
            str(path.relative_to(self.root)): str(path.readlink()) if path.is_symlink() else path.read_bytes()
            for path in sorted(self.root.rglob("*"))
            if path.is_symlink() or path.is_file()
        }


@pytest.fixture
def toy(tmp_path, monkeypatch, capfd) -> Toy:
    (tmp_path / "pipeline.yaml").write_text(PIPELINE_YAML)
    (tmp_path / "robot" / "toy").mkdir(parents=True)
    (tmp_path / "robot" / "toy" / "robot.yaml").write_text("mass: 1\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("HQPIPE_TRACEBACK", raising=False)
    for name, value in ENVIRONMENT.items():
        # The command sets what is not set; this puts it back after the test.
        monkeypatch.setenv(name, os.environ.get(name, value))
    return Toy(tmp_path, capfd)
