"""Runs cases in a forked worker that is watched: a reader must succeed, or refuse with file and fix, within 20 s."""

from __future__ import annotations

import json
import os
import resource
import select
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from hqpipe.errors import HqpipeError

from .processes import shows_fault
from .tally import Tally

LIMIT_S = 20.0
MEMORY_BYTES = 3 << 30  # beyond what the worker has already; no small document needs it
BATCH = 100  # cases of one worker


@dataclass(frozen=True)
class Target:
    """Something that reads a file from outside.

    Args:
        name: for the tally.
        base: folder with a valid example.
        changes: what may be changed in it, as plain JSON.
        apply: changes a copy of the folder. read: raises HqpipeError, or is content.
        place: what a refusal must name, see `Tally.message`.
    """

    name: str
    base: Path
    changes: st.SearchStrategy[Any]
    apply: Callable[[Path, Any], None]
    read: Callable[[Path], Any]
    place: str = "file"


class Refused(Exception):
    """A command refused: its exit code, what ``--json`` says under ``error``, and what it printed."""

    def __init__(self, code: int, error: dict[str, Any] | None, text: str) -> None:
        super().__init__(text)
        self.code, self.error = code, error


def try_case(target: Target, change: Any, folder: Path) -> dict[str, Any]:
    """Apply `change` to a fresh copy of the example and read it; what came of it."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(target.base, folder)
    target.apply(folder, change)
    try:
        target.read(folder)
    except HqpipeError as error:
        return _refusal(error.exit_code, error.to_json(), str(error))
    except Refused as refused:
        return _refusal(refused.code, refused.error, str(refused))
    except BaseException as error:
        return {"end": "exception", "text": f"{type(error).__name__}: {error} ({_place(error)})"}
    return {"end": "accepted"}


def _refusal(code: int, error: dict[str, Any] | None, text: str) -> dict[str, Any]:
    if shows_fault(text) or not 1 <= code <= 5:
        return {"end": "exception", "text": f"exit {code}: {text}"}
    return {"end": "refused", "error": error, "text": text}


def _place(error: BaseException) -> str:
    """The last line of our own on the way to the error."""
    at, trace = "?", error.__traceback__
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if "site-packages" not in name and "tests/torture" not in name:
            at = f"{'/'.join(name.split('/')[-2:])}:{trace.tb_lineno}"
        trace = trace.tb_next
    return at


def fuzz(target: Target, number: int, folder: Path, tally: Tally, inputs: Path, cases: int = BATCH) -> None:
    """Try a batch of cases, all of which follow from `number`.

    Args:
        inputs: where changes are written that showed a failure, for ``--repeat``.
    """
    kind = "odd files"
    reader, writer = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(reader)
        _work(target, number, folder, os.fdopen(writer, "w"), cases)
    os.close(writer)
    change, started = None, time.monotonic()
    with os.fdopen(reader, "rb", buffering=0) as stream:
        lines = _Lines(stream.fileno())
        while True:
            line = lines.next(LIMIT_S)
            if line is None:
                os.kill(pid, signal.SIGKILL)
                waited = time.monotonic() - started
                _failed(tally, "hang", kind, target, f"no answer for {waited:.0f} s", change, inputs)
                break
            if line == b"":
                break
            message = json.loads(line)
            if "change" in message:
                change, started = message["change"], time.monotonic()
                tally.count(kind, target.name)
                continue
            _tell(tally, kind, target, message, change, inputs)
            change = None
    _, status = os.waitpid(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code not in (0, -signal.SIGKILL) or (code == -signal.SIGKILL and line is not None):
        _failed(tally, "traceback", kind, target, f"the process died with {code}", change, inputs)


def _tell(tally: Tally, kind: str, target: Target, message: dict, change: Any, inputs: Path) -> None:
    tally.count("odd files, by end", message["end"])
    if message["end"] == "exception":
        _failed(tally, "traceback", kind, target, message["text"], change, inputs)
    elif message["end"] == "refused":
        tally.message(message["error"], f"{target.name}: {message['text']}", target.place)


def _failed(tally: Tally, failure: str, kind: str, target: Target, detail: str, change: Any, inputs: Path) -> None:
    inputs.mkdir(parents=True, exist_ok=True)
    place = inputs / f"{target.name.replace('/', '_')}-{failure}-{len(tally.problems)}.json"
    place.write_text(json.dumps({"target": target.name, "change": change}))
    tally.problem(failure, kind, target.name, detail, str(place))


class _Lines:
    """Lines from a pipe, with a limit on the wait for each."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor, self.buffer = descriptor, b""

    def next(self, limit: float) -> bytes | None:
        """The next line; b"" at the end, None when nothing comes."""
        while b"\n" not in self.buffer:
            ready, _, _ = select.select([self.descriptor], [], [], limit)
            if not ready:
                return None
            chunk = os.read(self.descriptor, 1 << 16)
            if not chunk:
                return b""
            self.buffer += chunk
        line, _, self.buffer = self.buffer.partition(b"\n")
        return line


def _work(target: Target, number: int, folder: Path, stream: Any, cases: int) -> None:
    """In the worker: try the cases, one line before and one after each."""
    if "torch" in sys.modules:  # a fork has none of the threads that its parent's arithmetic waits for
        sys.modules["torch"].set_num_threads(1)
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY_BYTES, size + MEMORY_BYTES))

    def send(message: dict) -> None:
        stream.write(json.dumps(message) + "\n")
        stream.flush()

    @seed(number)
    @settings(
        max_examples=cases,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(change=target.changes)
    def run(change: Any) -> None:
        send({"change": change})
        send(try_case(target, change, folder))

    code = 0
    try:
        run()
    except BaseException as error:
        send({"end": "exception", "text": f"the harness: {type(error).__name__}: {error}"})
        code = 0
    finally:
        os._exit(code)
