"""How large a log set is in memory, known before its rows are decoded: a small file can ask for all of it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from hqpipe.errors import LogError
from hqpipe.logs.columns import Shape

_VALUE = 8  # bytes, float64
_COPIES = 3  # of the whole log set while it is read: as decoded, as trials, and what the checks work on
_CGROUP = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"))


def check_size(folder: Path, shapes: Iterable[Shape], *, rows_at_a_time: int | None = None) -> None:
    """Refuse logs that do not fit into memory.

    Args:
        folder: for the message. shapes: of the files.
        rows_at_a_time: how many rows are in memory where the files are read in pieces; None if they are read whole.

    Raises:
        LogError: names the largest file and its size.
    """
    shapes = list(shapes)
    clocks = sum(shape.rows for shape in shapes)  # every clock is kept whole
    if rows_at_a_time is None:
        values = sum(shape.rows * len(shape.names) for shape in shapes)
    else:
        values = clocks + rows_at_a_time * max(len(shape.names) for shape in shapes)
    needed, room = _COPIES * _VALUE * values, memory_bytes()
    if needed <= room:
        return
    worst = max(shapes, key=lambda shape: shape.rows * len(shape.names))
    raise LogError(
        f"{worst.path}: {worst.rows} rows of {len(worst.names)} columns; the logs in {folder} need "
        f"{needed / 2**30:.1f} GiB of memory, there are {room / 2**30:.1f} GiB",
        file=worst.path,
        fix="list fewer or shorter trials in logset.yaml, drop columns that are not used, or lower the sample rate",
    )


def memory_bytes() -> int:
    """The memory that this process may have, bytes: of the machine, its container and its limits."""
    limits = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for path in _CGROUP:
        text = path.read_text(encoding="ascii").strip() if path.is_file() else ""
        if text.isdigit():
            limits.append(int(text))
    try:
        import resource  # not on Windows

        limits += [n for n in resource.getrlimit(resource.RLIMIT_AS) if n != resource.RLIM_INFINITY]
    except ImportError:
        pass
    return min(limits)
