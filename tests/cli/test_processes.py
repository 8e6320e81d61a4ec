"""What needs a process of its own: kill, lock, imports."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

TOY = Path(__file__).with_name("toy_pipeline.py")
SLOW = ("--set", "square_up.steps=100000")


def start(toy, *arguments: str) -> subprocess.Popen:
    """A slow run in another process, stopped in the middle of its second stage."""
    command = [sys.executable, str(TOY), *arguments]
    pipe = subprocess.PIPE
    # A shell's background jobs ignore Ctrl-C and pass that on; this process must hear it.
    hears = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    process = subprocess.Popen(command, cwd=toy.root, stdout=pipe, stderr=pipe, text=True, **hears)
    deadline = time.monotonic() + 60
    while not list(toy.artifacts.glob("store/.tmp-*/half.txt")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, "the slow stage did not start"
        time.sleep(0.02)
    return process


def test_killed_run_leaves_no_result_and_resumes(toy):
    process = start(toy, "run", "all", *SLOW)
    process.kill()
    process.communicate()
    assert list(toy.artifacts.glob("store/.tmp-*"))
    assert not (toy.artifacts / "squares").exists()
    assert len(list((toy.artifacts / "store").glob("[0-9a-f]*"))) == 1
    (checkpoint,) = toy.artifacts.glob("scratch/*/step")
    checkpoint.write_text("99999")
    answer = toy("run", "all", *SLOW, "--json")
    assert answer.actions == {"numbers": "kept", "square-up": "ran", "report": "ran"}
    assert answer.data["stages"][1]["metrics"]["resumed_from"] == 99999
    assert not list(toy.artifacts.glob("store/.tmp-*")) and not list(toy.artifacts.glob("scratch/*"))
    assert not (toy.artifacts / "squares" / "half.txt").exists()


def test_force_discards_the_checkpoint(toy):
    process = start(toy, "run", "all", *SLOW)
    process.kill()
    process.communicate()
    (checkpoint,) = toy.artifacts.glob("scratch/*/step")
    key = checkpoint.parent.name
    checkpoint.write_text("99999")
    shutil.rmtree(next(toy.artifacts.glob("store/.tmp-*")))
    process = start(toy, "square-up", "--set", "steps=100000", "--force")
    process.kill()
    process.communicate()
    assert [path.parent.name for path in toy.artifacts.glob("scratch/*/step")] == [key]
    assert checkpoint.read_text() != "99999"


def test_ctrl_c_exits_130_with_one_line(toy):
    process = start(toy, "run", "all", *SLOW)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert [line for line in err.splitlines() if "interrupted" in line] and "Traceback" not in err
    assert not list(toy.artifacts.glob("store/.tmp-*"))


def test_second_run_is_locked_out_and_told_by_whom(toy):
    process = start(toy, "run", "all", *SLOW)
    try:
        answer = toy("run", "all")
        assert answer.code == 5
        assert f"process {process.pid}" in answer.err
        # Looking is allowed meanwhile.
        assert toy("status").code == 3
    finally:
        process.kill()
        process.communicate()
    assert toy("run", "all").code == 0


def imported_by(*arguments: str) -> set[str]:
    """Modules that the real command line has loaded when it ends, with hqpipe's own tables."""
    code = (
        "import sys, json; from hqpipe.cli import run_cli; from hqpipe.stages import STAGES\n"
        f"code = run_cli(STAGES, {list(arguments)!r})\n"
        "print(json.dumps([code, sorted(sys.modules)]), file=sys.stderr)"
    )
    root = Path(__file__).parents[2]
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=True)
    status, modules = json.loads(result.stderr.splitlines()[-1])
    assert status == 0, result.stderr
    return set(modules)


@pytest.mark.parametrize("arguments", [("--help",), ("--version",), ("dag",)])
def test_help_imports_nothing_heavy(arguments):
    heavy = {
        "torch",
        "numpy",
        "pydantic",
        "rich",
        "yaml",
        "pyarrow",
        "mujoco",
        "pybullet",
        "scipy",
    }
    assert not imported_by(*arguments) & heavy


def test_planning_the_real_chain_imports_no_science():
    heavy = {
        "torch",
        "stable_baselines3",
        "pyarrow",
        "mujoco",
        "pybullet",
        "scipy",
        "matplotlib",
        "onnxruntime",
    }
    assert not imported_by("run", "all", "--dry-run") & heavy


def test_version_and_help_of_the_installed_command():
    command = Path(sys.executable).with_name("hqpipe")
    result = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert result.stdout.startswith("hqpipe ")
    text = subprocess.run([command, "--help"], capture_output=True, text=True, check=True).stdout
    assert text.index("  bootstrap ") < text.index("  fit-actuator ") < text.index("  validate ")


def test_thread_settings_of_the_user_are_kept(toy, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_WAIT_POLICY")
    toy("numbers")
    manifest = json.loads((toy.artifacts / "numbers" / "manifest.json").read_text())
    assert os.environ["OMP_WAIT_POLICY"] == "PASSIVE" and os.environ["OMP_NUM_THREADS"] == "3"
    assert "threads" in manifest["provenance"]["machine"]
