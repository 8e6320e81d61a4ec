"""Free runs of one record with one row of numbers after the other: what a change leaves as it was is not computed again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hqpipe.machine.chain import Signals, Work, loops


class RepeatedRun:
    """The windows of one joint; not for several threads at a time."""

    def __init__(self) -> None:
        self._work: Work | None = None  # made by the first run: most joints that are tried are never run
        self._out = np.empty((0, 0))

    def errors(self, row: np.ndarray, signals: Signals, versions: Mapping[str, float]) -> np.ndarray:
        """(steps, W) what `residual_windows` gives; overwritten by the next call.

        Args:
            row: (WIDTH,). signals: of the record. versions: of those of them that are not always the same, see
                `hqpipe.machine.chain.Loops.arranged`.
        """
        if self._work is None:
            self._work = loops().make_work(signals)
            self._out = np.empty((signals.steps, len(signals.first)))
        loops().fill_errors(row, signals, self._work, self._out, versions)
        return self._out
