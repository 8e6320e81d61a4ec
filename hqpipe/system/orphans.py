"""A process that ends with the one that started it, in whatever way that ends."""

from __future__ import annotations

import os
import signal
import threading


def end_with_parent(pipe: int) -> None:
    """End this process at once when its parent has ended, or end it now if it has.

    A thread waits for the end of the pipe; and where the system can, it sends SIGIO then, which also ends a process whose
    compiled code lets no thread run. (PR_SET_PDEATHSIG would end it with the *thread* that started it.)

    Args:
        pipe: the end to read from of a pipe that nobody writes into, and whose other end only the parent holds.
    """
    if hasattr(os, "O_ASYNC"):
        import fcntl

        signal.signal(signal.SIGIO, signal.SIG_DFL)
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    threading.Thread(target=_exit_after, args=(pipe,), daemon=True).start()


def _exit_after(pipe: int) -> None:
    os.read(pipe, 1)
    os._exit(1)
