"""One writer at a time: a lock on the artifacts folder that the operating system frees if its holder dies."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hqpipe.errors import IntegrityError, LockedError, UsageError
from hqpipe.system.failures import reported

# The record is read for a message only; a command line of many overrides is cut there.
_RECORD_BYTES = 65536


@contextmanager
def exclusive(artifacts: Path) -> Iterator[None]:
    """Hold the lock of `artifacts` (made if absent), without waiting for it.

    The lock is on the file ``.lock``, which stays and holds who has it. It needs no room on the disk where it has been
    used before; the record of its holder is left out where there is none.

    Raises:
        LockedError: another process holds it; the message says which.
        UsageError: the folder cannot be written.
        IntegrityError: something that is no file stands in the lock's place.
    """
    path = artifacts / ".lock"
    with reported(artifacts):
        artifacts.mkdir(parents=True, exist_ok=True)
        descriptor = _open(path)
    pid = os.getpid()
    try:
        _take(descriptor, path)
        _record(descriptor, {"pid": pid, "command": " ".join(["hqpipe", *sys.argv[1:]])})
        try:
            yield
        finally:
            # A forked worker that unwinds through here has inherited the lock but does not own it.
            if os.getpid() == pid:
                with suppress(OSError):
                    os.ftruncate(descriptor, 0)
                fcntl.flock(descriptor, fcntl.LOCK_UN)
    finally:
        os.close(descriptor)


def _open(path: Path) -> int:
    """A descriptor of the lock's file; a link is not followed, and nothing is truncated."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
        if stat.S_ISREG(os.fstat(descriptor).st_mode):
            return descriptor
        os.close(descriptor)
    except OSError as error:
        if error.errno not in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
            raise
    raise IntegrityError(f"{path} is not a regular file", file=path, fix="remove it, then run again")


def _take(descriptor: int, path: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise LockedError(
            f"{path.parent} is in use{_holder(descriptor)}", file=path.parent, fix="wait for it to end"
        ) from None
    except OSError as error:
        raise UsageError(
            f"{path} cannot be locked ({error.strerror})",
            file=path,
            fix="keep the project on a file system that has locks, e.g. a local disk",
        ) from error


def _record(descriptor: int, record: dict[str, object]) -> None:
    """Write down who holds the lock, for the message of who does not get it."""
    with suppress(OSError):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps(record).encode()[:_RECORD_BYTES], 0)


def _holder(descriptor: int) -> str:
    """Who holds the lock, as far as its record can be read at this moment."""
    try:
        record = json.loads(os.pread(descriptor, _RECORD_BYTES, 0))
        pid, command = int(record["pid"]), record["command"]
        ended = "" if _is_alive(pid) else "; it has ended, but a worker process of it has not"
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return " by another process"
    return f" by process {pid} ({command}{ended})"


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
