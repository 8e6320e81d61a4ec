"""Kills the process at its n-th file operation; Python imports this by itself where the folder is on PYTHONPATH.

HQPIPE_TORTURE_KILL_AT=n kills before operation n; HQPIPE_TORTURE_COUNT=file writes how many there are.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys

AT, COUNT = "HQPIPE_TORTURE_KILL_AT", "HQPIPE_TORTURE_COUNT"
CHANGES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.symlink", "os.link", "os.truncate", "os.chmod"}
"""Audit events (docs.python.org/3/library/audit_events.html) that change a folder; os.replace tells os.rename."""
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_PLACE = "artifacts"


class Operations:
    """Counts the operations of this process on a project, and kills it before number `at` (0: never)."""

    def __init__(self, at: int = 0) -> None:
        self.at, self.seen = at, 0
        sys.addaudithook(self._hear)
        flush = os.fsync

        def fsync(descriptor: int) -> None:
            self._one()
            flush(descriptor)

        os.fsync = fsync

    def _hear(self, event: str, arguments: tuple) -> None:
        if event in CHANGES or (event == "open" and self._is_write(*arguments)):
            self._one()

    @staticmethod
    def _is_write(path: object, mode: object, flags: object) -> bool:
        return isinstance(flags, int) and bool(flags & _WRITES) and isinstance(path, str) and _PLACE in path

    def _one(self) -> None:
        self.seen += 1
        if self.seen == self.at:
            os.kill(os.getpid(), signal.SIGKILL)


def _follow_orders() -> None:
    """Take the orders out of the environment, so that worker processes do not follow them too."""
    at, count = int(os.environ.pop(AT, "0")), os.environ.pop(COUNT, "")
    if not at and not count:
        return
    operations = Operations(at)
    if count:
        pid = os.getpid()

        def write() -> None:
            if os.getpid() == pid:
                with open(count, "w") as stream:
                    stream.write(str(operations.seen))

        atexit.register(write)


_follow_orders()
