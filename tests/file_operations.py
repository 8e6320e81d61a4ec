"""Lets something happen before each file operation of a piece of work in turn: a kill, or another process."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

# Everything that changes names or opens files; reads are counted too, which costs nothing.
OPERATIONS = {
    "open",
    "os.chmod",
    "os.listdir",
    "os.mkdir",
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.scandir",
    "os.symlink",
    "os.truncate",
}
KILLED, FAILED, DONE = 9, 101, 100


def each_kill(work: Callable[[], None], prepare: Callable[[], None]) -> Iterator[int]:
    """Yield after `work` was killed before its first, second … file operation, until it comes to its end.

    Args:
        work: runs in a forked process. prepare: puts everything back as it was, before each time.
    """
    number, code = 0, KILLED
    while code == KILLED:
        number += 1
        prepare()
        code = _forked(work, number, lambda: os._exit(KILLED))
        assert code in (DONE, KILLED), f"the work failed at operation {number}"
        if code == KILLED:
            yield number


def each_interference(
    work: Callable[[], int], prepare: Callable[[], None], interfere: Callable[[], None], folder: Path
) -> Iterator[int]:
    """What `work` returns when `interfere` runs before its first, second … file operation in `folder`.

    Args:
        work: as of `each_kill`; returns a number below 100. prepare: as of `each_kill`.
    """
    number, code = 0, 0
    while code != DONE:
        number += 1
        prepare()
        code = _forked(work, number, interfere, folder)
        if code != DONE:
            yield code


def _forked(
    work: Callable[[], int | None], number: int, happening: Callable[[], None], folder: Path | None = None
) -> int:
    """The answer of `work` in a process of its own; `DONE` if it ends before its operation `number` in `folder`."""
    child = os.fork()
    if child == 0:
        _run(work, number, happening, "" if folder is None else str(folder))
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _run(work: Callable[[], int | None], number: int, happening: Callable[[], None], within: str) -> None:
    """Never returns; the process ends as if killed, without any `finally`."""
    count = 0

    def notice(event: str, arguments: tuple) -> None:
        nonlocal count
        if event in OPERATIONS and str(arguments[0]).startswith(within):
            count += 1
            if count == number:
                happening()

    # fsync comes between the operations above; it is counted as well.
    original = os.fsync

    def fsync(descriptor: int) -> None:
        notice("open", (within,))
        original(descriptor)

    os.fsync = fsync
    sys.addaudithook(notice)
    try:
        code = work()
    except BaseException:
        traceback.print_exc()
        os._exit(FAILED)
    os._exit(DONE if code is None or count < number else code)
