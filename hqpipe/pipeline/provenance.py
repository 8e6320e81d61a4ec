"""Where a result comes from: versions, git commit, machine. Recorded in the manifest, no part of the key."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import hqpipe

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "torch",
    "stable-baselines3",
    "gymnasium",
    "mujoco",
    "pybullet",
    "onnx",
    "onnxruntime",
    "pyarrow",
    "safetensors",
    "pydantic",
    "matplotlib",
    "pillow",
)
"""Packages that can change a result."""

# Thread counts change the order of sums and with it the last bits.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def provenance(root: Path) -> dict[str, Any]:
    """What is known about this process, for a project in `root`; plain data."""
    return {
        "hqpipe": hqpipe.__version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": ["hqpipe", *sys.argv[1:]],
        "python": platform.python_version(),
        "packages": _versions(),
        "git": _git(root),
        "machine": _machine(),
    }


@cache
def _versions() -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


@cache
def _git(root: Path) -> dict[str, Any] | None:
    """Commit and whether files differ from it; None outside a git checkout or without git."""
    try:
        commit = _run_git(root, "rev-parse", "HEAD")
        changes = _run_git(root, "status", "--porcelain")
    except (OSError, subprocess.CalledProcessError):
        return None
    return {"commit": commit.strip(), "dirty": bool(changes.strip())}


def _run_git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, errors="replace").stdout


@cache
def _machine() -> dict[str, Any]:
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_name(),
        "cores": len(os.sched_getaffinity(0)),
        "threads": {name: os.environ.get(name) for name in THREAD_VARIABLES},
    }


def _cpu_name() -> str:
    """The processor's model name; on Linux it is only in ``/proc/cpuinfo``."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        return platform.processor()
    return platform.processor()
