"""Clocks of foreign logs: seconds that increase, and how regular they are."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

MOST_DROPPED = 0.05  # share of rows; assumption: a clock with more of them is no clock


@dataclass(frozen=True)
class Regularity:
    """How a clock runs.

    Attributes:
        rate_hz: from the mean step. jitter: RMS deviation of the steps from whole medians, in medians. Both leave gaps out.
        gaps: steps of more than `GAP_SAMPLES` medians. longest_s: the longest step.
    """

    rate_hz: float
    jitter: float
    gaps: int
    longest_s: float


GAP_SAMPLES = 4.0  # median steps; assumption: over fewer missing samples a straight line is as good as the signal


def increasing(time: np.ndarray) -> tuple[np.ndarray, int, int]:
    """The rows of a clock that increase strictly, as many as possible.

    Args:
        time: (T,) s, NaN where it is missing.

    Returns:
        (T,) bool, the rows to keep; how many repeat the time stamp before them; how many are out of order or without time.
    """
    finite = np.isfinite(time)
    keep = finite.copy()
    present = time[finite]
    if len(present) > 1 and not (np.diff(present) > 0).all():
        keep[np.flatnonzero(finite)] = _longest_increasing(present)
    repeated = int((np.diff(present) == 0).sum()) if len(present) > 1 else 0
    return keep, repeated, int((~keep).sum()) - repeated


def _longest_increasing(values: np.ndarray) -> np.ndarray:
    """Which elements form the longest strictly increasing subsequence (patience sorting; Fredman 1975)."""
    tops: list[float] = []  # smallest last element of a subsequence of each length
    at: list[int] = []
    before = np.full(len(values), -1)
    for index, value in enumerate(values.tolist()):
        place = bisect_left(tops, value)
        before[index] = at[place - 1] if place else -1
        if place == len(tops):
            tops.append(value)
            at.append(index)
        else:
            tops[place], at[place] = value, index
    chosen = np.zeros(len(values), bool)
    index = at[-1] if at else -1
    while index >= 0:
        chosen[index] = True
        index = before[index]
    return chosen


def regularity(time: np.ndarray) -> Regularity:
    """How a strictly increasing clock (T,) in s runs; T is at least 2."""
    steps = np.diff(time)
    median = float(np.median(steps))
    gaps = steps > GAP_SAMPLES * median
    usual = steps[~gaps]
    samples = np.maximum(1.0, np.round(usual / median))  # a sample that is lost makes one step of two
    jitter = float(np.sqrt(np.mean((usual / median - samples) ** 2)))
    return Regularity(float(samples.sum() / usual.sum()), jitter, int(gaps.sum()), float(steps.max()))
