"""Keep the messages that pybullet prints from C away from the streams of the caller."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

STDOUT, STDERR = 1, 2
_C = ctypes.CDLL(None)


@contextmanager
def quiet(*descriptors: int) -> Iterator[None]:
    """Send these file descriptors to the null device for the duration of the block."""
    _flush()
    saved = [os.dup(descriptor) for descriptor in descriptors]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor in descriptors:
            os.dup2(null, descriptor)
        yield
    finally:
        _flush()  # what is buffered now would come out later
        for descriptor, copy in zip(descriptors, saved, strict=True):
            os.dup2(copy, descriptor)
            os.close(copy)
        os.close(null)


def _flush() -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    _C.fflush(None)
