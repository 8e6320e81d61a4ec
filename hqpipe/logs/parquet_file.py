"""Opening a Parquet file, and what is said of one that cannot be read."""

from __future__ import annotations

import errno
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hqpipe.errors import LogError

_BUFFER = 1 << 20  # bytes of a column read ahead, so that a file with one row group is not held either
_ENCRYPTED = b"PARE"  # ends a file with an encrypted footer; a plain one ends in PAR1
_AGAIN = "copy it again, or export it anew"
_PLACES = {
    errno.EACCES: "give yourself the right to read it",
    errno.ENOENT: "repair the link, or drop it from the log set",
    errno.ELOOP: "repair the link, or drop it from the log set",
}


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A `pyarrow.parquet.ParquetFile` that verifies the checksums of pages, where the file has them.

    Raises:
        LogError: what keeps the file from being opened, or from being read while it is open, in a user's terms.
    """
    import pyarrow.parquet as pq

    _check_file(path)
    with (
        explained(path),
        pq.ParquetFile(path, pre_buffer=False, buffer_size=_BUFFER, page_checksum_verification=True) as file,
    ):
        yield file


@contextmanager
def explained(path: Path, column: str | None = None) -> Iterator[None]:
    """Say in a user's terms what keeps a file, or one column of it, from being read.

    Raises:
        LogError: names the file and the column.
    """
    import pyarrow as pa

    where = f"{path}" if column is None else f"{path}: column '{column}'"
    try:
        yield
    except (MemoryError, pa.ArrowMemoryError) as error:
        raise LogError(
            f"{where}: does not fit into memory ({_reason(error)})",
            file=path,
            field=column,
            fix="cut the trial into shorter ones, or drop columns that are not used",
        ) from error
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:  # ValueError: a name that is no UTF-8
        if "checksum" in (reason := _reason(error)):
            what = "a page does not match its checksum: bytes of the file were changed"
        else:
            what = f"not a complete Parquet file ({reason})"
        raise LogError(f"{where}: {what}", file=path, field=column, fix=_AGAIN) from error


def _check_file(path: Path) -> None:
    """Refuse what is no regular file, cannot be read, is empty or encrypted."""
    try:
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind):
            what = "a folder" if stat.S_ISDIR(kind) else "no regular file"
            raise LogError(f"{path} is {what}, expected a Parquet file", file=path, fix="drop it from the log set")
        with path.open("rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(max(0, size - len(_ENCRYPTED)))
            end = stream.read()
    except (OSError, ValueError) as error:
        fix = _PLACES.get(getattr(error, "errno", None), _AGAIN)
        raise LogError(f"{path}: cannot be read ({_reason(error)})", file=path, fix=fix) from error
    if size == 0:
        raise LogError(
            f"{path}: the file is empty (0 bytes)",
            file=path,
            fix="record the trial again or drop it from the log set",
        )
    if end == _ENCRYPTED:
        raise LogError(f"{path}: the file is encrypted", file=path, fix="export it without encryption")


def _reason(error: Exception) -> str:
    """The first line of an error, short enough for a message."""
    text = (getattr(error, "strerror", None) or str(error)).strip() or type(error).__name__
    return text.splitlines()[0][:200]
