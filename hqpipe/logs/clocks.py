"""What the `time` column of a trial says: its rate, its jitter, the rows that are missing, and the rate that trials share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hqpipe.errors import LogError
from hqpipe.logs.columns import TIME

MOST_REPEATED = 0.01  # of the rows; assumption: a driver sends a sample twice now and then, a broken clock stands still
STEADY = 0.05  # jitter (RMS, share of a sample) that the models do not notice; assumption
SAME_RATE = 0.02  # assumption: trials may differ by the drift of a clock or the load of a bus
FARTHEST = (
    250.0  # ratio of sample times; 5 kHz and 20 Hz, the ends of what joints are logged at; a unit of time is 1000
)
_NOMINAL = 1e-3  # assumption: a clock that is off by less was meant to run at the nominal rate
_JITTER_SIGMAS = 8.0  # assumption: a step beyond this many robust sigmas of the clock is a missing sample
_STEPS = (1e-9, 1e11)  # s between samples; 10 kHz counted in days is 1e-9, 100 s counted in ns is 1e11


@dataclass(frozen=True, eq=False)
class Clock:
    """The clock of a trial.

    Attributes:
        dt: s between samples that follow each other. seconds: from the first row to the last.
        jitter_rms, jitter_max: deviation of their steps from `dt`, as shares of it.
        lost: (T − 1,) rows that are missing between each row and the next.
        repeated: how many rows bore the time of the row before, and were left out.
    """

    dt: float
    seconds: float
    jitter_rms: float
    jitter_max: float
    lost: np.ndarray
    repeated: int = 0


def clock(column: np.ndarray) -> np.ndarray:
    """The `time` column (T,) as int64 or float64: integers keep their digits, for nanoseconds have more than a float."""
    return column.astype(np.int64 if column.dtype.kind in "iu" else np.float64, copy=False)


def repeated_rows(path: Path, time: np.ndarray) -> np.ndarray:
    """(T,) True for rows that bear the time of the row before.

    Args:
        path: for the messages. time: (T,) from `clock`, finite.

    Raises:
        LogError: the clock runs backwards, stands still in more than 1 % of the rows, or counts in no unit of time.
    """
    steps = np.diff(time).astype(np.float64)
    if (steps < 0).any() or (steps == 0).sum() > max(1, MOST_REPEATED * len(time)):
        bad = steps < 0 if (steps < 0).any() else steps == 0
        row = int(np.argmax(bad)) + 1
        what = "runs backwards" if steps[row - 1] < 0 else "repeats"
        raise LogError(
            f"{path}: column 'time', row {row}: {time[row]:.6f} after {time[row - 1]:.6f}, the clock {what} "
            f"({int(bad.sum())} such rows); expected strictly increasing seconds",
            file=path,
            field=TIME,
            fix="sort the rows and drop duplicates",
        )
    median = np.median(steps)
    if not _STEPS[0] <= median <= _STEPS[1]:
        raise LogError(
            f"{path}: column 'time' steps by {median:.6g}, expected seconds between samples, e.g. 0.001",
            file=path,
            field=TIME,
            fix="write the time in seconds",
        )
    return np.append(False, steps == 0)


def read_clock(time: np.ndarray, repeated: int = 0) -> Clock:
    """Rate, jitter and missing rows of a clock.

    Args:
        time: (T,) from `clock`, strictly increasing. repeated: rows that were left out for it.
    """
    steps = np.diff(time).astype(np.float64)
    median = float(np.median(steps))
    whole = steps <= gap_limit(steps)
    own = steps[whole] if whole.any() else steps
    deviation = own / median - 1.0
    rms = float(np.sqrt(np.mean(deviation**2)))
    dt = median if rms <= STEADY else float(own.mean())  # the mean of many steps is no coarser than the clock
    lost = np.where(whole, 0, np.maximum(np.round(steps / dt) - 1, 1)).astype(np.int64)
    return Clock(dt, float(time[-1] - time[0]), rms, float(np.abs(deviation).max()), lost, repeated)


def gap_limit(steps: np.ndarray) -> float:
    """The longest of the steps (T − 1,) that no missing row is needed to explain."""
    median = np.median(steps)
    spread = 1.4826 * np.median(np.abs(steps - median))
    return float(median + max(0.5 * median, _JITTER_SIGMAS * spread))


def shared_dt(clocks: Iterable[tuple[float, int]], stated_hz: float | None = None) -> float:
    """Sample time that trials are brought to, s: the one at which most of the samples were recorded.

    Samples and not seconds, so that one trial whose time counts in another unit decides nothing.

    Args:
        clocks: (sample time in s, rows) of each trial.
        stated_hz: nominal rate in logset.yaml; it counts where it agrees with the clocks.
    """
    groups: list[list[tuple[float, int]]] = []
    for each in sorted(clocks):
        if groups and each[0] <= groups[-1][0][0] * (1.0 + SAME_RATE):
            groups[-1].append(each)
        else:
            groups.append([each])
    dt = float(np.median([dt for dt, _ in max(groups, key=lambda group: sum(rows for _, rows in group))]))
    return 1.0 / stated_hz if stated_hz and abs(dt * stated_hz - 1.0) <= _NOMINAL else dt


def is_near(own: float, dt: float) -> bool:
    """Whether a trial of one sample time can be brought to another: beyond that it counts in another unit of time."""
    return 1.0 / FARTHEST <= own / dt <= FARTHEST


def jitter(time: np.ndarray) -> tuple[float, float]:
    """RMS and largest deviation of the sample time from its median, as shares of the median."""
    steps = np.diff(time)
    median = np.median(steps)
    deviation = (steps - median) / median
    return float(np.sqrt(np.mean(deviation**2))), float(np.abs(deviation).max())


def is_regular(own: Clock, dt: float) -> bool:
    """Whether rows that follow each other can stay as recorded: next to no jitter, and the shared rate."""
    return own.jitter_rms <= STEADY and abs(own.dt / dt - 1.0) <= SAME_RATE
