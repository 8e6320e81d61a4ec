"""Standard output is for the command's own answer; what a stage prints goes to standard error."""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

STDOUT, STDERR = 1, 2


@contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Send whatever is printed inside to standard error, by Python, by C libraries and by child processes."""
    sys.stdout.flush()
    saved = os.dup(STDOUT)
    try:
        os.dup2(STDERR, STDOUT)
        with redirect_stdout(sys.stderr):
            yield
    finally:
        # C libraries buffer on their own; what they hold back would appear on the restored standard output.
        ctypes.CDLL(None).fflush(None)
        os.dup2(saved, STDOUT)
        os.close(saved)


def print_json(data: Any) -> None:
    """Print plain data on standard output."""
    print(json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False))
