"""A project with three toy stages (tests/cli/toy_pipeline.py), and its commands in forked processes: ten a second."""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .chain import whole
from .processes import ROOT, Ended

sys.path.insert(0, str(ROOT / "tests" / "cli"))
from toy_pipeline import PIPELINE_YAML, TABLE

from hqpipe.cli import run_cli

LIMIT_S = 30.0
ARTIFACTS = TABLE.artifacts


def make_toy(folder: Path) -> Path:
    """An empty toy project."""
    (folder / "robot" / "toy").mkdir(parents=True, exist_ok=True)
    (folder / "robot" / "toy" / "robot.yaml").write_text("mass: 1\n")
    (folder / "pipeline.yaml").write_text(PIPELINE_YAML.replace("square_up: {", "square_up: {steps: 2, "))
    return folder


@dataclass
class Fork:
    """A toy command in a forked child."""

    pid: int
    reader: int
    out: Path
    err: Path

    def wait(self, limit: float = LIMIT_S) -> Ended:
        deadline = time.monotonic() + limit
        # The child's end closes its side of the pipe.
        ready, _, _ = select.select([self.reader], [], [], max(0.0, deadline - time.monotonic()))
        if not ready:
            os.kill(self.pid, signal.SIGKILL)
        _, status = os.waitpid(self.pid, 0)
        os.close(self.reader)
        code = os.waitstatus_to_exitcode(status) if ready else None
        texts = [path.read_text(errors="replace") for path in (self.out, self.err)]
        for path in (self.out, self.err):
            path.unlink()
        return Ended(code, *texts, orphans=[])


def fork(project: Path, arguments: Sequence[str], prepare: Callable[[], None] = lambda: None) -> Fork:
    """Start ``hqpipe`` with these arguments on the toy stages; `prepare` runs in the child before."""
    place = project.parent / f"{project.name}-{time.monotonic_ns()}"
    out, err = place.with_suffix(".out"), place.with_suffix(".err")
    reader, writer = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writer)
        return Fork(pid, reader, out, err)
    code = 99
    try:
        os.close(reader)
        for path, descriptor in ((out, 1), (err, 2)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", closefd=False)
        os.chdir(project)
        prepare()
        code = run_cli(TABLE, arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def toy(project: Path, *arguments: str, prepare: Callable[[], None] = lambda: None) -> Ended:
    """Run one command to its end."""
    return fork(project, arguments, prepare).wait()


def results(project: Path) -> dict[str, dict[str, str] | None]:
    """Output hashes of every artifact, as far as it is whole."""
    return {name: whole(project, name) for name in ARTIFACTS}


def leftovers(project: Path) -> list[Path]:
    """What is half-written; a checkpoint of a committed result costs space only, and gc --all removes it."""
    return list((project / "artifacts").glob("**/.tmp-*"))


def copy(project: Path, target: Path) -> Path:
    return Path(shutil.copytree(project, target, symlinks=True))
