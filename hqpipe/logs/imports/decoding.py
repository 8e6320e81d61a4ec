"""What is said of a foreign file that a library cannot decode."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hqpipe.errors import HqpipeError
from hqpipe.files.documents import check_file
from hqpipe.logs.imports.recording import ImportLogError
from hqpipe.logs.size import memory_bytes

AGAIN = "copy it again, or export it anew"
_COPIES = 3  # in memory at once: as stored, as decoded, and as fields
_NO_LIMIT = 2**62  # bytes


@contextmanager
def decoding(path: Path, what: str, fix: str = AGAIN, streamed: bool = False) -> Iterator[None]:
    """Check the file, and restate what the library says of it.

    Args:
        path: the file; a folder is not checked. what: the kind of file, with its article, e.g. "a MAT file".
        fix: what to do about a damaged one. streamed: whether it is read in parts, so that it may be larger than the memory.

    Raises:
        ImportLogError: no regular file, empty, truncated, or not what its suffix says.
    """
    if not (path.is_dir() and streamed):
        check_file(path, AGAIN, _NO_LIMIT if streamed else memory_bytes(), ImportLogError)
    try:
        yield
    except HqpipeError:
        raise
    except MemoryError as error:
        message = f"{path}: does not fit into memory, or says that it holds more than it does"
        raise ImportLogError(message, file=path, fix="cut it into shorter files") from error
    except Exception as error:  # decoders of damaged files raise whatever their last line of code raises
        reason = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        raise ImportLogError(f"{path}: not {what} that can be read ({reason})", file=path, fix=fix) from error


def check_bytes(path: Path, needed: int) -> None:
    """Refuse a file whose arrays, as it declares them, do not fit into memory.

    Args:
        path: the file. needed: bytes of the arrays.

    Raises:
        ImportLogError: names both sizes.
    """
    room = memory_bytes()
    if needed * _COPIES > room:
        message = f"{path}: its arrays take {needed / 2**30:.1f} GiB, there are {room / 2**30:.1f} GiB of memory"
        raise ImportLogError(message, file=path, fix="cut it into shorter files, or drop arrays that are not used")
