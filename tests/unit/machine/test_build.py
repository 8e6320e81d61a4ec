"""The written loops of a chain: where they are put, and what happens where they cannot be."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import numpy as np
from hqpipe.machine import EFFECTS
from hqpipe.machine.bases.pd import PD
from hqpipe.machine.chain import Loops
from hqpipe.machine.compose.wiring import Chain
loops = Loops(Chain(PD, [EFFECTS["valve_lag"]]))
row = loops.chain.neutral_row()
row[:2] = 3.0, 1.0
tau = np.zeros(1)
loops.step_row(row[None], tau, np.zeros((1, loops.memory)), np.ones(1), np.zeros(1), np.ones(1))
print(tau[0], loops._module.__file__)
"""


def start(cache: Path, *prefix: str):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    pipe = subprocess.PIPE
    return subprocess.Popen([*prefix, sys.executable, "-c", CODE], env=environment, stdout=pipe, stderr=pipe, text=True)


def finished(process) -> tuple[float, str]:
    out, problem = process.communicate()
    assert process.returncode == 0, problem
    torque, file = out.split()
    return float(torque), file


def test_they_lie_in_the_cache_folder_under_their_hash(tmp_path):
    torque, file = finished(start(tmp_path))
    assert torque == 2.0 and Path(file).parent == tmp_path / "chains" and Path(file).is_file()
    compile(Path(file).read_text(), file, "exec")
    assert finished(start(tmp_path)) == (torque, file)


def test_processes_that_write_them_at_the_same_time_agree(tmp_path):
    running = [start(tmp_path) for _ in range(4)]
    assert len({finished(process) for process in running}) == 1
    assert [path.suffix for path in (tmp_path / "chains").iterdir() if path.is_file()] == [".py"]


def test_a_damaged_file_is_written_anew(tmp_path):
    _, file = finished(start(tmp_path))
    Path(file).write_text("raise SystemExit(3)\n")
    assert finished(start(tmp_path)) == (2.0, file)


@pytest.mark.parametrize("cache", ["/dev/null/nowhere", "/proc/nowhere"])
def test_without_a_folder_they_live_in_memory(cache):
    torque, file = finished(start(Path(cache)))
    assert torque == 2.0 and file.startswith("<hqpipe_chain_pd_")
