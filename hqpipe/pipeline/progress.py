"""Tells on standard error how far a stage is: a bar on a terminal, one line a minute otherwise."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from hqpipe.pipeline.context import Progress

INTERVAL_S = 60.0
"""Time between two lines where there is no terminal."""


class LineProgress:
    """Prints a line at most every `interval_s` seconds.

    Args:
        stage: name shown at the start of each line.
        interval_s: least time between two lines.
        clock: monotonic time in seconds.
    """

    def __init__(self, stage: str, interval_s: float = INTERVAL_S, clock=time.monotonic) -> None:
        self._stage = stage
        self._interval = interval_s
        self._clock = clock
        self._last = clock()

    def __call__(self, done: float, total: float, note: str = "") -> None:
        now = self._clock()
        if now - self._last < self._interval:
            return
        self._last = now
        share = f"{100 * done / total:.0f} %" if total else f"{done:g}"
        print(f"{self._stage}: {share}{'  ' if note else ''}{note}", file=sys.stderr, flush=True)


@contextmanager
def stage_progress(stage: str) -> Iterator[Progress]:
    """Announce `stage` and yield its progress callback."""
    if not sys.stderr.isatty():
        print(f"{stage}: started", file=sys.stderr, flush=True)
        yield LineProgress(stage)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    # The bar keeps its own copy of standard error, because a stage's output is redirected around it.
    with Bars(*columns, console=Console(file=sys.stderr), redirect_stdout=False, transient=True) as bars:
        task = bars.add_task(stage, total=None, note="")

        def update(done: float, total: float, note: str = "") -> None:
            bars.update(task, completed=done, total=total or None, note=note)

        yield update
