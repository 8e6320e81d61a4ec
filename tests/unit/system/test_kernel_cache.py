"""Compiled kernels are kept where they can be, and damage to what is kept breaks nothing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hqpipe.pipeline.doctor import examine
from hqpipe.system import kernel_cache

NOWHERE = "/dev/null/nowhere"  # not even root can make a folder here

TWICE = """
import json, sys
import numpy as np
from numba import njit
import hqpipe.system.checked_cache

@njit(cache=True)
def twice(x):
    return 2 * x

first = sys.argv[1:] or ["int"]
values = [twice({"int": 3, "float": 1.5}[name]) for name in first]
print(json.dumps([values, sum(twice.stats.cache_hits.values())]))
"""


def run(folder: Path, *kinds: str, cache: str = "") -> tuple[list[float], int]:
    """Values of a compiled function, and how many compiled codes came from the cache."""
    script = folder / "twice.py"
    script.write_text(TWICE)
    environment = os.environ | {"NUMBA_CACHE_DIR": cache or str(folder / "cache")}
    result = subprocess.run([sys.executable, script, *kinds], env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    values, hits = json.loads(result.stdout)
    return values, hits


def chosen(**environment: str) -> str | None:
    """What a new process takes."""
    code = "import os, hqpipe; print(os.environ.get('NUMBA_CACHE_DIR', ''))"
    kept = {
        name: text for name, text in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME")
    }
    result = subprocess.run([sys.executable, "-c", code], env=kept | environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_damaged_files_are_compiled_anew(tmp_path, kind):
    assert run(tmp_path) == ([6], 0)
    (path,) = (tmp_path / "cache").rglob(kind)
    whole = path.read_bytes()
    middle = len(whole) // 2
    flipped = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    for damaged in (b"", whole[:middle], flipped):
        path.write_bytes(damaged)
        assert run(tmp_path)[0] == [6]
        assert run(tmp_path) == ([6], 1)


def test_code_that_is_filed_under_another_name_is_not_run(tmp_path):
    """As two processes leave it that compile the function for different arguments at the same time."""
    run(tmp_path, "int", "float")
    one, two = sorted((tmp_path / "cache").rglob("*.nbc"))
    two.write_bytes(one.read_bytes())
    assert run(tmp_path, "int", "float") == ([6, 3.0], 1)
    assert run(tmp_path, "int", "float") == ([6, 3.0], 2)


def test_a_folder_that_goes_missing_is_done_without(tmp_path):
    assert run(tmp_path, cache=NOWHERE) == ([6], 0)


def test_a_full_disk_is_done_without(tmp_path):
    script = tmp_path / "limited.sh"
    script.write_text(f"ulimit -f 0; trap '' XFSZ; exec {sys.executable} {tmp_path / 'twice.py'}\n")
    run(tmp_path, cache=str(tmp_path / "other"))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    pipe = subprocess.PIPE
    result = subprocess.run(["bash", script], env=environment, stdout=pipe, stderr=pipe, text=True)
    assert result.returncode == 0 and json.loads(result.stdout) == [[6], 0], result.stderr


@pytest.mark.parametrize(
    "module",
    [
        "actuators.loops.laws",
        "identify.sign_path",
        "identify.paper_model.window_fit",
        "machine",
        "plant.plant",
        "sim.mujoco_loop",
        "sim.pybullet_robot",
        "layers.servo",
        "layers.valve",
        "layers.joint_motion",
        "benchmark.cases.electric.drives",
    ],
)
def test_every_way_to_compiled_code_leads_through_the_check(module):
    code = f"import sys, hqpipe.{module}; print('numba' in sys.modules, 'hqpipe.system.checked_cache' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() in (["True", "True"], ["False", "False"])


def test_the_folder_is_the_users_own_choice_then_the_cache_then_a_temporary_one(tmp_path):
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    temporary.mkdir()
    assert chosen(NUMBA_CACHE_DIR=NOWHERE, HOME=str(home)) == NOWHERE
    assert chosen(XDG_CACHE_HOME=str(tmp_path / "xdg"), HOME=str(home)).startswith(f"{tmp_path}/xdg/hqpipe/numba/")
    assert chosen(HOME=str(home), TMPDIR=str(temporary)).startswith(f"{home}/.cache/hqpipe/numba/")
    own = temporary / f"hqpipe-{os.getuid()}"
    assert chosen(HOME=NOWHERE, TMPDIR=str(temporary)).startswith(f"{own}/numba/")
    assert own.stat().st_mode & 0o777 == 0o700


def test_a_temporary_folder_that_others_may_write_is_not_trusted(tmp_path):
    own = tmp_path / f"hqpipe-{os.getuid()}"
    own.mkdir()
    own.chmod(0o777)
    assert not chosen(HOME=NOWHERE, TMPDIR=str(tmp_path)).startswith(str(own))
    own.rmdir()
    own.symlink_to("/")
    assert not chosen(HOME=NOWHERE, TMPDIR=str(tmp_path)).startswith(str(own))


def test_doctor_says_which_folder_and_whether_it_can_be_written(tmp_path, monkeypatch):
    for folder, ok in ((tmp_path / "not" / "there" / "yet", True), (Path(NOWHERE), False)):
        monkeypatch.setenv(kernel_cache.VARIABLE, str(folder))
        (found,) = [finding for finding in examine(tmp_path) if finding.name == "kernel cache"]
        assert found.ok is ok and str(folder) in found.detail
