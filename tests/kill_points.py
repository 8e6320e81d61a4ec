"""Kills a piece of work before each of its file operations in turn."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Iterator

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
KILLED, FAILED = 9, 1


def each_kill(work: Callable[[], None], prepare: Callable[[], None]) -> Iterator[int]:
    """Yield after `work` was killed before its first, second … file operation, until it comes to its end.

    Args:
        work: runs in a forked process. prepare: puts everything back as it was, before each time.
    """
    number = 0
    while True:
        number += 1
        prepare()
        child = os.fork()
        if child == 0:
            _run(work, number)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert code in (0, KILLED), f"the work failed at operation {number}"
        if code == 0:
            return
        yield number


def _run(work: Callable[[], None], last: int) -> None:
    """Never returns; the process ends as if killed, without any `finally`."""
    count = 0

    def count_down(event: str, arguments: tuple) -> None:
        nonlocal count
        if event in OPERATIONS:
            count += 1
            if count == last:
                os._exit(KILLED)

    # fsync comes between the operations above; it is counted as well.
    original = os.fsync

    def fsync(descriptor: int) -> None:
        count_down("open", ())
        original(descriptor)

    os.fsync = fsync
    sys.addaudithook(count_down)
    try:
        work()
    except BaseException:
        traceback.print_exc()
        os._exit(FAILED)
    os._exit(0)
