"""The arrows between packages: ``.importlinter`` for hqpipe/, and the like for stages/, which lies outside."""

from __future__ import annotations

import ast
import configparser
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
STAGE_FILES = sorted((ROOT / "stages").rglob("*.py"))

# Imported inside functions only, so that a stage's parameters are known in milliseconds.
HEAVY = {
    "matplotlib",
    "mujoco",
    "onnx",
    "onnxruntime",
    "PIL",
    "plotly",
    "pyarrow",
    "pybullet",
    "scipy",
    "stable_baselines3",
    "torch",
}

# A stage reaches these through sim/ and rl/.
BEHIND_A_PACKAGE = {"mujoco", "pybullet", "stable_baselines3", "torch"}

# What a stage may know of the pipeline half; a group of commands also how the command line talks.
PIPELINE = {"hqpipe.pipeline.config", "hqpipe.pipeline.context"}
TALKING = {"hqpipe.pipeline.answer", "hqpipe.pipeline.options", "hqpipe.pipeline.progress", "hqpipe.pipeline.streams"}
GROUPS = {"blind/commands.py"}
GROUP_FOLDERS = {"log_commands"}


def test_contracts_are_kept():
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout


def test_every_package_has_a_contract():
    parser = configparser.ConfigParser()
    parser.read(ROOT / ".importlinter")
    sources = {name for section in parser.values() for name in section.get("source_modules", "").split()}
    covered = {".".join(name.split(".")[:2]) for name in sources}
    folders = {f"hqpipe.{path.parent.name}" for path in (ROOT / "hqpipe").glob("*/__init__.py")}
    files = {f"hqpipe.{path.stem}" for path in (ROOT / "hqpipe").glob("[a-z]*.py")}
    assert folders | files == covered


def imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Every imported module of a file, and whether it is imported when the file is."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inner = {
        child
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for child in ast.walk(function)
        if isinstance(child, ast.Import | ast.ImportFrom)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node not in inner
        elif isinstance(node, ast.ImportFrom):
            yield node.module, node not in inner


@pytest.mark.parametrize("path", STAGE_FILES, ids=lambda path: path.stem)
def test_stage_imports(path):
    for module, at_top in imports(path):
        package = module.partition(".")[0]
        assert package not in BEHIND_A_PACKAGE, f"{path.name} imports {module}: call hqpipe.sim or hqpipe.rl"
        assert not (at_top and package in HEAVY), f"{path.name} imports {module} at the top: move it into run"
        if module.startswith("hqpipe.pipeline") and path.name != "__init__.py":
            group = path.relative_to(ROOT / "stages").as_posix() in GROUPS or path.parent.name in GROUP_FOLDERS
            allowed = PIPELINE | TALKING if group else PIPELINE
            assert module in allowed, f"{path.name} imports {module}, expected one of {sorted(allowed)}"
        assert module != "hqpipe.cli", f"{path.name} imports the command line"
