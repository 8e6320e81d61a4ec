"""SIGTERM and SIGHUP end a command as Ctrl-C does: by an exception, so that everything is put in order on the way out."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

FIRST_ON_SIGNAL: list[Callable[[], None]] = []
"""Called before the exception is raised: what would otherwise hold up the way out."""


class Interrupted(BaseException):
    """The process was asked to end.

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
    raise Interrupted(number)
