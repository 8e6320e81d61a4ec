"""SIGTERM and SIGHUP end a command as Ctrl-C does: by an exception, so that everything is put in order on the way out."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

STATE, REMEDY = "interrupted: nothing half-made was kept", "the same command goes on from here"
MESSAGE = f"{STATE}; {REMEDY}"
SHOW_CURSOR = "\x1b[?25h"  # a bar of progress hides it

GRACE_S = 5.0
"""Time to put things in order, which takes a second or two unless threads still compute: less than the 10 s that `docker stop`
waits, and nothing is lost by leaving sooner."""

FIRST_ON_SIGNAL: list[Callable[[], None]] = []
"""Called before the exception is raised: what would otherwise hold up the way out."""


class Interrupted(BaseException):
    """The process was asked to end; it is ended `GRACE_S` later if this has not come out at the top by then.

    Args:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.exit_code = 128 + number  # as shells have it


def raise_on_signals() -> None:
    """Let signals that ask the process to end raise `Interrupted`; what is ignored (``nohup``) stays ignored."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise)


def ignore_signals() -> None:
    """The process is about to end by itself."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def end(error: Interrupted) -> NoReturn:
    """Say so, and exit with the code of the signal."""
    ignore_signals()
    print(MESSAGE, file=sys.stderr)
    sys.exit(error.exit_code)


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Hold Ctrl-C back for the duration of the block: a process that is started in it inherits that, and so can ignore it
    before it could be hit."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _raise(number: int, frame: FrameType | None) -> None:
    error = sys.exception()
    while error is not None:
        if isinstance(error, Interrupted):
            return  # on the way out already: let that come to its end
        error = error.__context__
    for action in FIRST_ON_SIGNAL:
        action()
    error = Interrupted(number)
    # Not threading.Thread: its locks may be held by the very code that the signal has interrupted.
    _thread.start_new_thread(_leave, (error.exit_code,))
    raise error


def _leave(code: int) -> None:
    """End the process if it has not ended by itself in `GRACE_S`."""
    time.sleep(GRACE_S)
    try:
        print(f"{SHOW_CURSOR if sys.stderr.isatty() else ''}{MESSAGE}", file=sys.stderr, flush=True)
    finally:
        os._exit(code)
