"""What a command answers under ``--json``: one object on standard output, printed once, however the command ends."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from typing import Any

from hqpipe.pipeline.streams import print_json, stdout_to_stderr

_own: ContextVar[dict[str, Any] | None] = ContextVar("answer", default=None)

ASKED = "--json"
# Options that print text on standard output and end there.
TEXT = ("--help", "--version")


def is_asked_for(arguments: Sequence[str]) -> bool:
    """Whether a command line wants JSON; told from the words alone, so that one that cannot be parsed is answered too."""
    words = arguments[: arguments.index("--")] if "--" in arguments else arguments
    return any(word == ASKED or word.startswith(f"{ASKED}=") for word in words)


def answer(**fields: Any) -> None:
    """Hand over the command's own part of the answer: plain data. A later call adds to it, or replaces what it names.

    ``error``, as of `HqpipeError.to_json`, says what is wrong where the command exits with a code and raises no error.
    """
    own = _own.get()
    if own is not None:
        own.update(fields)


@contextmanager
def answering(arguments: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Collect what commands hand over inside; whatever else they print goes to standard error, but not help."""
    own: dict[str, Any] = {}
    token = _own.set(own)
    try:
        with nullcontext() if set(TEXT) & set(arguments) else stdout_to_stderr():
            yield own
    finally:
        _own.reset(token)


def print_answer(own: dict[str, Any], code: int, error: dict[str, Any] | None) -> None:
    """Print the object: ``ok``, ``exit_code`` and ``error`` first, then the command's own keys.

    Args:
        own: what the command handed over.
        code: its exit code.
        error: what it failed with, as of `HqpipeError.to_json`; None if it raised nothing.
    """
    error = error or (own.get("error") if code else None)
    if code and error is None:
        error = {"message": f"exit code {code}", "file": None, "field": None, "fix": None}
    head = {"ok": code == 0, "exit_code": code, "error": error and {**error, "exit_code": code}}
    print_json(_plain({**head, **{key: value for key, value in own.items() if key not in head}}))


def _plain(value: Any) -> Any:
    """The value with null for NaN and inf, which JSON lacks, and text for what it has no word for."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)
