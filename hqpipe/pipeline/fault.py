"""An exception that no stage means to raise, as one line that says where in our own code it happened."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hqpipe
from hqpipe.errors import HqpipeError

FIX = "run it again with --traceback, and report what that prints"


def unexpected(name: str, run: Callable[..., Any], error: Exception) -> HqpipeError:
    """The failure of the stage `name`, whose function is `run`.

    A library's path says nothing to a user; the last line of ours before it says what was being done.
    """
    message = f"{name} failed: {type(error).__name__}: {error}".rstrip(": ")
    place = _place(run, error)
    return HqpipeError(f"{message} ({place})" if place else message, fix=FIX)


def _place(run: Callable[..., Any], error: Exception) -> str:
    """``stages/collect.py:52``: the last line in hqpipe or beside the stage's own file."""
    folders = [Path(folder).resolve() for folder in hqpipe.__path__]
    if (own := inspect.getsourcefile(run)) is not None:
        folders.append(Path(own).resolve().parent)
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        path = Path(frame.filename).resolve()
        for folder in folders:
            if path.is_relative_to(folder) and path != Path(__file__).with_name("executor.py").resolve():
                return f"{path.relative_to(folder.parent)}:{frame.lineno}"
    return ""
