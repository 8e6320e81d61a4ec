"""Writes that survive a kill and a power cut: what has its name is whole, and is on the disk.

The order is always the same: write under a temporary name, flush the files, then their folders, rename, flush the
folder above. Whatever a kill leaves has a name that begins with `TEMPORARY`.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import shutil
from pathlib import Path

TEMPORARY = ".tmp-"
"""Begins the names of what is being written or removed."""
REPLACED = f"{TEMPORARY}old-"
"""Begins the name of what is being replaced where two names cannot be exchanged in one step."""
CHECKSUMS = "SHA256SUMS"
"""Hashes of all files in a folder, as ``sha256sum --check`` reads them."""

# linux/fs.h and linux/fcntl.h.
_RENAME_EXCHANGE, _AT_FDCWD = 2, -100
# What renameat2 answers on file systems, and old kernels, that cannot exchange.
_NO_EXCHANGE = (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP)
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


def sync(path: Path) -> None:
    """Flush a file, or a folder's list of names, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot flush a folder; they write names through.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def sync_tree(folder: Path) -> None:
    """Flush every file and folder in `folder`, itself last."""
    for parent, _, files in os.walk(folder, topdown=False):
        for name in files:
            sync(Path(parent) / name)
        sync(Path(parent))


def write_file(path: Path, content: str | bytes) -> None:
    """Write or replace a file in one step; text is written as UTF-8."""
    data = content.encode() if isinstance(content, str) else content
    temporary = path.with_name(f"{TEMPORARY}{path.name}-{os.getpid()}")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync(path.parent)


def new_folder(target: Path) -> Path:
    """An empty folder beside `target`, to be filled and given to `move_into_place`."""
    folder = target.with_name(f"{TEMPORARY}{target.name}-{os.getpid()}")
    remove(folder)
    folder.mkdir(parents=True)
    return folder


def move_into_place(folder: Path, target: Path) -> None:
    """Give a finished folder its name in one step, replacing whatever has that name.

    Args:
        folder: on the same file system as `target`.
        target: what had this name is removed.
    """
    sync_tree(folder)
    if not os.path.lexists(target):
        os.rename(folder, target)
        sync(target.parent)
        return
    if not _exchange(folder, target):
        replaced = target.with_name(f"{REPLACED}{target.name}")
        remove(replaced)
        os.rename(target, replaced)
        os.rename(folder, target)
        folder = replaced
    sync(target.parent)
    _delete(folder)


def _exchange(first: Path, second: Path) -> bool:
    """Swap two names in one step; False where the system cannot."""
    function = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if function is None:
        return False
    if function(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in _NO_EXCHANGE:
        return False
    raise OSError(number, os.strerror(number), os.fspath(first), None, os.fspath(second))


def remove(path: Path) -> None:
    """Remove a file, link or whole folder, if it is there; its name is gone before the first of its files is."""
    if not os.path.lexists(path):
        return
    if path.is_dir() and not path.is_symlink() and not path.name.startswith(TEMPORARY):
        gone = path.with_name(f"{TEMPORARY}gone-{path.name[:12]}-{os.getpid()}")
        remove(gone)
        try:
            os.rename(path, gone)
        except OSError as error:
            # On a full disk even a name may find no room, and this is what makes some.
            if error.errno not in _NO_SPACE:
                raise
        else:
            path = gone
    _delete(path)


def _delete(path: Path) -> None:
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
        return
    try:
        shutil.rmtree(path)
    except PermissionError:
        _make_writable(path)
        shutil.rmtree(path)


def _make_writable(folder: Path) -> None:
    """Let the owner remove what is in `folder`."""
    folder.chmod(0o700)
    for item in os.scandir(folder):
        if item.is_dir(follow_symlinks=False):
            _make_writable(Path(item.path))


def remove_leftovers(folder: Path) -> list[Path]:
    """Remove from `folder` what killed processes left, and put back what was being replaced; return the leftovers."""
    leftovers = sorted(folder.glob(f"{TEMPORARY}*"))
    for path in leftovers:
        target = path.with_name(path.name.removeprefix(REPLACED))
        if path.name.startswith(REPLACED) and not os.path.lexists(target):
            os.rename(path, target)
            sync(folder)
        else:
            remove(path)
    return leftovers


def write_checksums(folder: Path) -> None:
    """Write `CHECKSUMS` of all other files in `folder`."""
    (folder / CHECKSUMS).write_text(_checksums(folder), encoding="utf-8")


def damage(folder: Path) -> str | None:
    """What is wrong with a folder that `write_checksums` finished, in words; None if every byte is as it was."""
    if not (folder / CHECKSUMS).is_file():
        return f"it has no {CHECKSUMS}"
    try:
        stated = (folder / CHECKSUMS).read_bytes()
        return None if stated == _checksums(folder).encode() else f"its files do not fit its {CHECKSUMS}"
    except OSError as error:
        return f"{Path(error.filename or folder).name}: {error.strerror}"


def _checksums(folder: Path) -> str:
    lines = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / CHECKSUMS):
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.relative_to(folder).as_posix()}\n")
    return "".join(lines)
