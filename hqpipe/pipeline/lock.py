"""One writer at a time: a lock on the artifacts folder that the operating system frees if its holder dies."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from hqpipe.errors import LockedError, UsageError


@contextmanager
def exclusive(artifacts: Path) -> Iterator[None]:
    """Hold the lock of `artifacts` (made if absent), without waiting for it.

    Raises:
        LockedError: another process holds it; the message says which.
        UsageError: the folder cannot be written.
    """
    holder = artifacts / ".lock-holder.json"
    lock = FileLock(artifacts / ".lock", timeout=0)
    try:
        artifacts.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise LockedError(f"{artifacts} is in use{_describe(holder)}: wait for it to end") from None
    except OSError as error:
        raise UsageError(
            f"{artifacts} cannot be written ({error.strerror}): make it writable, or copy the project"
        ) from None
    pid = os.getpid()
    try:
        record = {"pid": pid, "command": " ".join(["hqpipe", *sys.argv[1:]])}
        holder.write_text(json.dumps(record), encoding="utf-8")
        yield
    finally:
        # A forked worker that unwinds through here has inherited the lock but does not own it.
        if os.getpid() == pid:
            holder.unlink(missing_ok=True)
            lock.release()


def _describe(holder: Path) -> str:
    """Who holds the lock, as far as its record can be read at this moment."""
    try:
        record = json.loads(holder.read_text(encoding="utf-8"))
        pid, command = int(record["pid"]), record["command"]
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return " by another process"
    ended = "" if _is_alive(pid) else "; it has ended, but a worker process of it has not"
    return f" by process {pid} ({command}{ended})"


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
