"""What a full disk, missing memory and other failures of the operating system mean, and what to do about them."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hqpipe.errors import HqpipeError, UsageError

_ROOM = "remove old results with `hqpipe gc` (and unfinished ones with --all), or make room"
_WRITABLE = "make it writable, or copy the project to a place that is"
_OPEN_FILES = "raise the limit (`ulimit -n 4096`), or use fewer workers (`workers: 1` in pipeline.yaml)"
_MEMORY = "use fewer workers (`workers: 1` in pipeline.yaml) or environments (`num_envs`), or close other programs"

# errno → (kind of error, what is wrong, what to do).
_FAILURES: dict[int, tuple[type[HqpipeError], str, str]] = {
    errno.ENOSPC: (HqpipeError, "the disk is full", _ROOM),
    errno.EDQUOT: (HqpipeError, "the disk quota is used up", _ROOM),
    errno.EFBIG: (
        HqpipeError,
        "the file would be larger than this process or file system allows",
        "raise the limit (`ulimit -f unlimited`), or use another file system",
    ),
    errno.EROFS: (UsageError, "the file system is read-only", _WRITABLE),
    errno.EACCES: (UsageError, "permission denied", "change its owner or permissions, or copy the project"),
    errno.EPERM: (UsageError, "operation not permitted", "change its owner or permissions, or copy the project"),
    errno.ENAMETOOLONG: (UsageError, "the name is too long", "shorten it, or move the project up to a shorter path"),
    errno.ELOOP: (UsageError, "too many symbolic links", "replace the link by what it stands for"),
    errno.ENOTDIR: (UsageError, "a file stands where a folder is expected", "move the file away"),
    errno.EISDIR: (UsageError, "a folder stands where a file is expected", "move the folder away"),
    errno.EMFILE: (HqpipeError, "too many open files in this process", _OPEN_FILES),
    errno.ENFILE: (HqpipeError, "too many open files on this machine", _OPEN_FILES),
    errno.EIO: (HqpipeError, "the disk failed to read or write", "check the disk, and restore the file from a copy"),
    errno.ENOMEM: (HqpipeError, "not enough memory", _MEMORY),
    errno.EAGAIN: (HqpipeError, "the limit on processes or threads is reached", _MEMORY),
}

# How libraries written in C and Rust put the number into the text of an error of their own (h5py, safetensors).
_NUMBER_IN_TEXT = re.compile(r"(?:\berrno[ =]+|\bos error |\bOs \{ code: )(\d+)", re.IGNORECASE)
# torch says so in a RuntimeError.
_MEMORY_IN_TEXT = ("can't allocate memory", "not enough memory", "out of memory", "bad_alloc")


def system_failure(error: BaseException, folder: Path | None = None) -> HqpipeError | None:
    """The error to report for a failure of the operating system; None if `error` is something else.

    Args:
        error: as it was raised; what caused it is looked at as well.
        folder: where it was writing, named where the error itself names no file.
    """
    if isinstance(error, HqpipeError):
        return None
    if isinstance(error, RecursionError):
        text = "the data or the configuration is nested too deeply"
        return HqpipeError(text, file=folder, fix="use a file with fewer levels")
    number = _number(error)
    if number in _FAILURES:
        kind, text, fix = _FAILURES[number]
        named = getattr(error, "filename", None)
        place = Path(os.fsdecode(named)) if isinstance(named, str | bytes) else folder
        if number == errno.ENOSPC and place is not None:
            text += _free(place)
        return kind(f"{place}: {text}" if place else text, file=place, fix=fix)
    return system_failure(error.__cause__, folder) if error.__cause__ else None


def _number(error: BaseException) -> int | None:
    """The number of the failure in `errno`'s table, from the error or from its text."""
    if isinstance(error, MemoryError):
        return errno.ENOMEM
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    text = str(error)
    if isinstance(error, RuntimeError) and any(words in text.lower() for words in _MEMORY_IN_TEXT):
        return errno.ENOMEM
    found = _NUMBER_IN_TEXT.search(text)
    return int(found.group(1)) if found else None


def _free(place: Path) -> str:
    """`` (1.2 MB free)`` of the disk that holds `place`, which need not exist."""
    try:
        while not place.exists():
            place = place.parent
        return f" ({shutil.disk_usage(place).free / 1e6:.1f} MB free)"
    except OSError:
        return ""


@contextmanager
def reported(folder: Path) -> Iterator[None]:
    """Raise a failure of the operating system inside as the error to report; arguments as of `system_failure`."""
    try:
        yield
    except Exception as error:
        if failure := system_failure(error, folder):
            raise failure from error
        raise
