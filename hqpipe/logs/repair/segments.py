"""Stretches of a trial without a gap: what is missing within one can be bridged, what is missing between two cannot."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

_MOST = 9  # samples; assumption: beyond that the log is rather cut than guessed, however slow the motion is
_ERROR = (
    0.02  # of a position's standard deviation; assumption: what a straight line may err by where it stands for samples
)


def bridgeable(positions: Iterable[np.ndarray]) -> int:
    """How many samples in a row a straight line may stand for: as many as the motion is slow, 1 … 9.

    Tried on samples that were recorded: the middle one of every 2m + 1 is compared with the mean of the outer two.

    Args:
        positions: (T,) position of each joint, NaN where missing.
    """
    moving = [q - np.nanmean(q) for q in positions if np.isfinite(q).any() and np.nanstd(q) > 0]
    limit = 1
    for half in range(2, (_MOST + 1) // 2 + 1):
        errors = [q[half:-half] - 0.5 * (q[: -2 * half] + q[2 * half :]) for q in moving if len(q) > 4 * half]
        shares = [
            np.sqrt(np.nanmean(e**2)) / np.nanstd(q)
            for e, q in zip(errors, moving, strict=False)
            if np.isfinite(e).any()
        ]
        if not shares or np.median(shares) > _ERROR:
            break
        limit = 2 * half - 1
    return limit


def stretches(lost: np.ndarray, missing: np.ndarray, most: int, least: int) -> list[tuple[int, int]]:
    """First row and the one after the last of every stretch without a long gap.

    Args:
        lost: (T − 1,) rows that the clock skips after each row. missing: (T,) whether a channel that is needed has no value.
        most: samples in a row that are bridged. least: rows of a stretch; shorter ones are left out.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    usable = np.ones(len(missing), dtype=bool)
    for start, stop in runs:
        at_end = start == 0 or stop == len(missing)
        if at_end or stop - start > most:
            usable[start:stop] = False
    cuts = np.append(np.flatnonzero(lost > most) + 1, len(missing))
    found, begin = [], 0
    for cut in cuts:
        inside = np.flatnonzero(np.diff(np.concatenate([[False], usable[begin:cut], [False]]).astype(np.int8)))
        found += [(begin + a, begin + b) for a, b in inside.reshape(-1, 2)]
        begin = cut
    trimmed = [_trimmed(start, stop, missing) for start, stop in found]
    return [(start, stop) for start, stop in trimmed if stop - start >= least]


def _trimmed(start: int, stop: int, missing: np.ndarray) -> tuple[int, int]:
    """Without missing samples at either end, which nothing bridges."""
    present = np.flatnonzero(~missing[start:stop])
    return (start + int(present[0]), start + int(present[-1]) + 1) if len(present) else (start, start)
