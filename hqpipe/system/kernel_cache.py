"""Where compiled kernels are kept between runs."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
"""Names the folder to numba; what a user sets here is kept."""

_COMPILED = ("actuators", "benchmark", "identify", "layers", "machine", "plant", "sim", "sysid")


def set_folder() -> None:
    """Choose the folder for this process and its workers.

    Where none can be written, numba has its own way: beside the sources.
    """
    if VARIABLE not in os.environ:
        for folder in _candidates():
            if is_writable(folder):
                os.environ[VARIABLE] = str(folder / "numba" / _state_of_sources())
                return


def is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which may have to be made itself."""
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


def _candidates() -> Iterator[Path]:
    """The cache of the user, then a folder for temporary files."""
    named = os.environ.get("XDG_CACHE_HOME")
    home = os.path.expanduser("~")  # as it is where a user has no home
    if named:
        yield Path(named) / "hqpipe"
    elif home != "~":
        yield Path(home) / ".cache" / "hqpipe"
    for place in (os.environ.get("TMPDIR"), "/tmp", "/var/tmp"):
        if place and (folder := _of_this_user(Path(place) / f"hqpipe-{os.getuid()}")):
            yield folder


def _of_this_user(folder: Path) -> Path | None:
    """The folder if nobody else can put code into it; it is made if it is not there."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    safe = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if safe else None


def _state_of_sources() -> str:
    """A name for exactly these sources.

    numba reuses a compiled function as long as its own file is unchanged, even if a function that it inlines has
    changed in another; hence one folder per state of all sources that hold compiled functions.
    """
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(path for name in _COMPILED for path in (root / name).rglob("*.py")):
        state = path.stat()
        digest.update(f"{path.relative_to(root)} {state.st_mtime_ns} {state.st_size}\n".encode())
    return digest.hexdigest()[:16]
