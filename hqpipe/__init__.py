"""hqpipe: close the sim-to-real gap of heavy hydraulic legged robots."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

__version__ = "0.1.0"


_COMPILED = ("effects", "kernels", "plant", "sim")


def _compiled_code() -> Path:
    """Folder of compiled code that belongs to exactly these sources.

    numba reuses a compiled function as long as its own file is unchanged, even if a function that it inlines has
    changed in another; hence one folder per state of all sources that hold compiled functions.
    """
    root = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(path for name in _COMPILED for path in (root / name).glob("*.py")):
        state = path.stat()
        digest.update(f"{path.relative_to(root)} {state.st_mtime_ns} {state.st_size}\n".encode())
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return caches / "hqpipe" / "numba" / digest.hexdigest()[:16]


os.environ.setdefault("NUMBA_CACHE_DIR", str(_compiled_code()))
