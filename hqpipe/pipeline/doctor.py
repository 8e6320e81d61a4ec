"""Is this machine ready? Quick checks, none of which imports a science package."""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from hqpipe.system.kernel_cache import VARIABLE, is_writable

MIN_PYTHON = (3, 11)
# A default chain with a few alternatives kept stays below this; assumption, generous.
MIN_FREE_BYTES = 2 * 10**9


@dataclass(frozen=True)
class Finding:
    """One check: its name, whether it passed, and what was seen (with what to do if it failed)."""

    name: str
    ok: bool
    detail: str

    def to_json(self) -> dict[str, str | bool]:
        return asdict(self)


def examine(artifacts: Path) -> list[Finding]:
    """All checks; `artifacts` is where a project keeps its results, which may not exist yet."""
    home = artifacts
    while not home.exists():
        home = home.parent
    return [_python(), _packages(), _cores(), _store(home), _disk(home), _kernel_cache()]


def _python() -> Finding:
    found = ".".join(str(part) for part in sys.version_info[:3])
    ok = sys.version_info[:2] >= MIN_PYTHON
    return Finding("python", ok, found if ok else f"{found}; hqpipe needs 3.11 or newer")


def _packages() -> Finding:
    """Every requirement of hqpipe is installed, and not older than its lower bound."""
    wrong, count = [], 0
    for requirement in requires("hqpipe") or []:
        if "extra ==" in requirement:
            continue
        count += 1
        name = re.match(r"[\w.-]+", requirement).group()
        bound = re.search(r">=\s*([\d.]+)", requirement)
        try:
            found = version(name)
        except PackageNotFoundError:
            wrong.append(f"{name} is not installed")
            continue
        if bound and _numbers(found) < _numbers(bound.group(1)):
            wrong.append(f"{name} is {found}, expected {bound.group(1)} or newer")
    mend = "install them with: pip install --upgrade hqpipe"
    return Finding("packages", not wrong, f"{', '.join(wrong)}; {mend}" if wrong else f"{count} installed")


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.match(r"\d+(\.\d+)*", text).group().split("."))


def _cores() -> Finding:
    return Finding("cores", True, f"{len(os.sched_getaffinity(0))} usable")


def _store(home: Path) -> Finding:
    """Files and links can be made where the artifacts go."""
    try:
        with tempfile.TemporaryDirectory(dir=home) as folder:
            (Path(folder) / "link").symlink_to("target")
    except OSError as error:
        return Finding("store", False, f"cannot write files and links in {home}: {error.strerror}")
    return Finding("store", True, f"{home} is writable")


def _disk(home: Path) -> Finding:
    free = shutil.disk_usage(home).free
    ok = free >= MIN_FREE_BYTES
    detail = f"{free / 1e9:.1f} GB free"
    return Finding("disk", ok, detail if ok else f"{detail}, expected {MIN_FREE_BYTES / 1e9:.0f} GB: hqpipe gc")


def _kernel_cache() -> Finding:
    """Compiled kernels can be kept, so that they are not compiled again in every process."""
    folder = os.environ.get(VARIABLE)
    if folder is None:
        return Finding("kernel cache", False, f"no folder for it is writable: set {VARIABLE} to one that is")
    if not is_writable(Path(folder)):
        return Finding(
            "kernel cache", False, f"{folder} is not writable: set {VARIABLE} to a folder that is, or unset it"
        )
    return Finding("kernel cache", True, f"{folder} is writable")
