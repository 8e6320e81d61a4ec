"""The parts of long trials that a joint is judged on: runs of windows, so that nothing between them need be predicted.

Delays, lags and slack are followed along a log from sample to sample. Windows that are spread evenly over an hour would have
all of it followed, for a small part of it to be judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MOST_WINDOWS = 240
"""Of a joint and split: 24 s of windows of 0.1 s say nearly what an hour says, as errors stay alike for longer than one."""
FEWEST_RUNS = 8  # of windows, so that they hold several motions; assumption
SHORTEST_RUN = 10  # windows; assumption: shorter ones would spend most of their time on what leads to them
LEAD = 5  # windows before a run from which it is followed: the memory of all that a window suits (`window_choice`)


@dataclass(frozen=True, eq=False)
class WindowRun:
    """The part of one trial that windows which follow each other need.

    Attributes:
        trial: its number. start, stop: first row, and the one behind the last. first: (W,) rows at which windows begin.
    """

    trial: int
    start: int
    stop: int
    first: np.ndarray

    def of(self, values: np.ndarray, per_row: int) -> np.ndarray:
        """The part of values that the whole trial has, `per_row` from one row to the next."""
        return values[self.start * per_row : (self.stop - 1) * per_row + 1]

    def samples(self, per_row: int) -> int:
        """How many `of` gives."""
        return (self.stop - 1 - self.start) * per_row + 1


def window_runs(rows: Sequence[int], starts: Sequence[np.ndarray], steps: int) -> list[WindowRun]:
    """Whole trials, or runs of windows evenly over all of them where these hold more than `MOST_WINDOWS`.

    There are two runs for each trial, as far as none is shorter than `SHORTEST_RUN`. They go from the first window to the last,
    and so move through trials that are alike.

    Args:
        rows: of each trial. starts: first rows of its windows, in their order. steps: rows of a window.
    """
    trial = np.repeat(np.arange(len(starts)), [len(s) for s in starts])
    first = np.concatenate(starts)
    if len(first) <= MOST_WINDOWS:
        return [WindowRun(k, 0, n, starts[k]) for k, n in enumerate(rows)]
    runs = int(np.clip(2 * len(rows), FEWEST_RUNS, MOST_WINDOWS // SHORTEST_RUN))
    length = MOST_WINDOWS // runs
    begin = np.linspace(0, len(first) - length, runs).round().astype(int)
    kept = (begin[:, None] + np.arange(length)).ravel()
    found: list[WindowRun] = []
    for k in np.unique(trial[kept]):
        own = first[kept[trial[kept] == k]]
        # Windows further apart than what leads to them belong to different runs.
        for run in np.split(own, np.flatnonzero(np.diff(own) > (1 + LEAD) * steps) + 1):
            found.append(WindowRun(int(k), max(int(run[0]) - LEAD * steps, 0), int(run[-1]) + steps + 1, run))
    return found
