"""Standard output is for the command's own answer; what a stage prints goes to standard error."""

from __future__ import annotations

import codecs
import ctypes
import io
import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

from hqpipe.errors import HqpipeError

STDIN, STDOUT, STDERR = 0, 1, 2

ASCII_SIGNS = {"→": "->", "←": "<-", "–": "-", "—": "-", "−": "-", "…": "...", "·": "*", "×": "x", "≤": "<=", "≥": ">="}
"""What people see for signs that the encoding of their terminal lacks; other signs become question marks."""

READABLE = "hqpipe.readable"
"""Name of the error handler of encodings that puts `ASCII_SIGNS`."""


class ReaderGone(Exception):
    """Nobody reads standard output any more, as after ``| head``."""


class _Stdout(io.FileIO):
    """Says that it is standard output which cannot be written."""

    def write(self, data: Any) -> int | None:
        try:
            return super().write(data)
        except BrokenPipeError as error:
            _abandon_stdout()
            raise ReaderGone from error
        except OSError as error:
            _abandon_stdout()
            raise HqpipeError(
                f"standard output cannot be written: {error.strerror}", file="/dev/stdout", fix="send it somewhere else"
            ) from error


class _Stderr(io.FileIO):
    """Loses what cannot be written: a terminal that has closed ends no run that is to outlive it."""

    def write(self, data: Any) -> int | None:
        try:
            return super().write(data)
        except OSError:
            return len(data)


def prepare_streams() -> None:
    """Make the standard streams writable, whatever they are: closed, full, or of an encoding that lacks some signs.

    A closed one becomes the null device, lest a file that is opened later takes its number and is written into.
    """
    for descriptor in (STDIN, STDOUT, STDERR):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    codecs.register_error(READABLE, _readable)
    sys.stdout = _text_stream(_Stdout(STDOUT, "w", closefd=False), sys.stdout)
    sys.stderr = _text_stream(_Stderr(STDERR, "w", closefd=False), sys.stderr)


def _text_stream(raw: io.FileIO, like: io.TextIOWrapper | None) -> io.TextIOWrapper:
    """A stream on `raw` in the encoding of `like`, buffered by lines on a terminal and on standard error."""
    encoding = like.encoding if like else "utf-8"
    by_lines = raw.fileno() == STDERR or raw.isatty()
    return io.TextIOWrapper(io.BufferedWriter(raw), encoding, READABLE, line_buffering=by_lines)


def _readable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(ASCII_SIGNS.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


def _abandon_stdout() -> None:
    """Nobody can read standard output any more: keep Python from complaining about what is left of it at exit."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, STDOUT)
    os.close(null)


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
    """Print plain data on standard output; beyond ASCII only where that is UTF-8, as readers of JSON expect."""
    text = json.dumps(data, indent=1, ensure_ascii=False)
    try:
        text.encode("utf-8" if codecs.lookup(sys.stdout.encoding or "utf-8").name == "utf-8" else "ascii")
    except UnicodeEncodeError:  # also a file name that is no text, in any encoding
        text = json.dumps(data, indent=1)
    print(text)
