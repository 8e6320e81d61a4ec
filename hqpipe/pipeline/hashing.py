"""SHA-256 of files, folders and plain data."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError

SHORT = 12
"""How many hexadecimal digits are enough to show (48 bits)."""


def canonical_json(data: Any) -> str:
    """Serialise plain data so that equal data gives equal text; NaN and inf raise ValueError."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def data_hash(data: Any) -> str:
    """SHA-256 of plain data, through its canonical JSON."""
    return hashlib.sha256(canonical_json(data).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def list_files(folder: Path, *, ignore: frozenset[str] = frozenset(), links: bool = False) -> list[str]:
    """Relative POSIX paths of the regular files in `folder`, sorted.

    Args:
        folder: an existing folder.
        ignore: names of files and folders to leave out, at any depth.
        links: take a link to a file for the file; a link to a folder is refused all the same.

    Raises:
        UsageError: a symbolic link, socket, pipe or device is in the folder; such content cannot be hashed.
        OSError: a folder cannot be read.
    """
    found = []
    for parent, folders, files in os.walk(folder, onerror=_raise):
        folders[:] = [name for name in folders if name not in ignore]
        for name in folders:
            path = Path(parent) / name
            if path.is_symlink():
                raise UsageError(f"{path} is a symbolic link", file=path, fix="put the files there instead")
        for name in files:
            if name in ignore:
                continue
            path = Path(parent) / name
            if not stat.S_ISREG((path.stat() if links and path.exists() else path.lstat()).st_mode):
                message = f"{path} is a symbolic link or a special file"
                raise UsageError(message, file=path, fix="put a regular file there instead")
            found.append(path.relative_to(folder).as_posix())
    return sorted(found)


def _raise(error: OSError) -> None:
    raise error


def hash_files(folder: Path, *, ignore: frozenset[str] = frozenset(), links: bool = False) -> dict[str, str]:
    """Relative path → SHA-256 of every file in `folder`; arguments and errors as in `list_files`."""
    return {name: file_hash(folder / name) for name in list_files(folder, ignore=ignore, links=links)}


def tree_hash(folder: Path, *, ignore: frozenset[str] = frozenset(), links: bool = False) -> str:
    """One hash over paths and bytes of all files in `folder`; arguments and errors as in `list_files`."""
    return data_hash(hash_files(folder, ignore=ignore, links=links))
