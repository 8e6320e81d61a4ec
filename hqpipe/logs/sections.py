"""Which rows of long logs are read: evenly spaced sections, whole trials where they are short."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEAST_S = 10.0  # of a section; assumption: long against the memory of a valve, a hose or an integrator
_LEAST_ROWS = 10  # of a section, where the clock counts no seconds
EXTRAS_PER_JOINT = 16  # columns that belong to no joint are kept once, those of a joint worked with; assumption

Rows = tuple[int, int]
"""First row and the one after the last."""


def rows_within(most: int, joints: int, extras: int) -> int:
    """How many rows hold `most` values per channel, a value being one joint in one row.

    Args:
        most: values. joints: number of joints. extras: number of columns that belong to no joint.
    """
    return max(1, int(most / max(joints, extras / EXTRAS_PER_JOINT)))


def shares(fit: int, heldout: int, most: int) -> tuple[int, int]:
    """Rows that each split may have: half of `most`, and what the other one leaves of its half."""
    held = min(heldout, max(most - fit, most // 2))
    return min(fit, most - held), held


def sections(trials: Sequence[tuple[int, float]], most: int) -> list[list[Rows]]:
    """Sections of at least 10 s, about `most` rows in all, evenly spaced over trials that are put end to end.

    Trials are cut into slots of 10 … 20 s (a shorter trial is one slot). Of all slots an even selection is taken, from
    the first to the last one, so that it moves through the trials where they are alike. Slots that touch are one section.

    Args:
        trials: (rows, sample time in s) of each trial of a split.
        most: rows.

    Returns:
        Per trial its sections in order; empty where none falls into it.
    """
    found: list[list[Rows]] = [[] for _ in trials]
    slots: list[tuple[int, Rows]] = []
    for index, (rows, dt) in enumerate(trials):
        slot = LEAST_S / dt if dt > 0.0 else rows  # a broken clock is refused when the rows are read
        count = max(1, min(int(rows / slot + 1e-6), rows // _LEAST_ROWS))
        edges = np.linspace(0, rows, count + 1).round().astype(int).tolist()
        slots += [(index, pair) for pair in zip(edges[:-1], edges[1:], strict=True)]
    count = min(len(slots), max(1, round(most * len(slots) / sum(rows for rows, _ in trials))))
    for at in np.linspace(0, len(slots) - 1, count).round().astype(int):
        index, (start, stop) = slots[at]
        if found[index] and found[index][-1][1] == start:
            start = found[index].pop()[0]
        found[index].append((start, stop))
    return found
