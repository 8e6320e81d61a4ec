"""Commands in processes of their own: started with a mark in their environment, ended, and looked for afterwards."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MARK = "HQPIPE_TORTURE_ID"
LAUNCH = Path(__file__).with_name("launch")
ROOT = Path(__file__).parents[2]
LIMIT_S = 300.0  # no command of the small project takes a tenth of it on two idle cores
GRACE_S = 3.0  # a process of the run that is there so long after its end is an orphan
_FAULTS = ("Traceback (most recent call last)", "--traceback", "site-packages")
"""What is printed only about an exception that nobody foresaw."""


@dataclass
class Ended:
    """How a command ended; `code` is negative for a signal, None for a hang."""

    code: int | None
    out: str
    err: str
    orphans: list[str]

    @property
    def told(self) -> bool:
        """Whether it ended with an error of its own, and not by a signal."""
        return self.code is not None and 0 < self.code <= 5

    @property
    def error(self) -> dict[str, Any] | None:
        """What ``--json`` answered under ``error``."""
        try:
            return json.loads(self.out).get("error")
        except (ValueError, AttributeError):
            return None

    @property
    def unforeseen(self) -> bool:
        return shows_fault(self.err) or shows_fault(self.out)


class Run:
    """A running ``hqpipe`` (or `command`) in `project`.

    Args:
        arguments: of hqpipe.
        environment: added to that of this process.
        prepare: called in the child before the command starts, to set its limits.
    """

    def __init__(
        self,
        project: Path,
        arguments: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        prepare: Callable[[], None] | None = None,
        command: Sequence[str] = (sys.executable, "-m", "hqpipe.cli"),
    ) -> None:
        self.mark = uuid.uuid4().hex
        self._files = [project.parent / f"{project.name}-{name}-{self.mark[:8]}" for name in ("out", "err")]
        before = {key: value for key, value in os.environ.items() if key != "HQPIPE_TRACEBACK"}
        streams = [path.open("wb") for path in self._files]
        self.process = subprocess.Popen(
            [*command, *arguments],
            cwd=project,
            stdin=subprocess.DEVNULL,
            stdout=streams[0],
            stderr=streams[1],
            env={**before, "COLUMNS": "200", MARK: self.mark, **(environment or {})},
            start_new_session=True,
            preexec_fn=lambda: _prepare(prepare),
        )
        for stream in streams:
            stream.close()

    def signal(self, number: int, group: bool = False) -> None:
        """Signal the main process alone, or all of its group as a terminal does."""
        try:
            (os.killpg if group else os.kill)(self.process.pid, number)
        except ProcessLookupError:
            pass

    def wait(self, limit: float = LIMIT_S) -> Ended:
        """Wait for the end; what is then left of the run is told, and killed."""
        try:
            code = self.process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
            self.process.kill()
            self.process.wait()
        orphans = survivors(self.mark, GRACE_S if code is not None else 0.0)
        out, err = (path.read_text(errors="replace") for path in self._files)
        for path in self._files:
            path.unlink()
        return Ended(code, out, err, orphans)


def shows_fault(text: str) -> bool:
    """Whether a command told of an exception that nobody foresaw."""
    return any(sign in text for sign in _FAULTS)


def hqpipe(project: Path, *arguments: str, limit: float = LIMIT_S, **how: Any) -> Ended:
    """Run one command to its end."""
    return Run(project, arguments, **how).wait(limit)


def kill_at(operation: int) -> dict[str, str]:
    """Environment in which the command kills itself before this file operation."""
    return {"PYTHONPATH": _path(), "HQPIPE_TORTURE_KILL_AT": str(operation)}


def counted(file: Path) -> dict[str, str]:
    """Environment in which the command writes into `file` how many file operations it made."""
    return {"PYTHONPATH": _path(), "HQPIPE_TORTURE_COUNT": str(file)}


def survivors(mark: str, grace: float) -> list[str]:
    """Command lines of the processes with this mark that are still there after `grace` seconds; they are killed."""
    deadline = time.monotonic() + grace
    while (found := _marked(mark)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for pid in found:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
    return list(found.values())


def _marked(mark: str) -> dict[int, str]:
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark.encode() in (folder / "environ").read_bytes():
                command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
                found[int(folder.name)] = command[:200]
        except OSError:
            continue  # it has ended, or belongs to somebody else
    return found


def _path() -> str:
    return os.pathsep.join([str(LAUNCH), *filter(None, [os.environ.get("PYTHONPATH")])])


def _prepare(prepare: Callable[[], None] | None) -> None:
    # A shell's background jobs ignore Ctrl-C and pass that on; the command must hear it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if prepare is not None:
        prepare()
