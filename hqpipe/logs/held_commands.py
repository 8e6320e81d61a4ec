"""When, between two rows of a log, a command changed that its sender holds from one cycle to the next.

A row only says that the command changed since the row before. A sender with a steady cycle that is no whole number of rows, as
a policy at 100 Hz beside a log at 250 Hz, gives all of its changes away together: one period and one phase put each of them
between its two rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from hqpipe.logs.finer_clock import between, held

FEWEST_CHANGES = 20  # from which a cycle is believed; assumption: so many that come by chance fit one next to never
SHORTEST_CYCLE = 1.2  # rows; assumption: what changes in nearly every row is a smooth curve
_ROUNDS = 5  # of numbering the cycles by their period and the other way round; assumption: two change nothing any more
_EXACT = 1e-6  # of a row: rounding of a change that falls on a row


@dataclass(frozen=True, eq=False)
class SteadySteps:
    """The changes of a command with a steady cycle.

    Attributes:
        rows: (K,) rows at which a new value is seen first. earliest, latest: (K,) when it came, in rows: later than
            `rows` − 1 and at `rows` at the latest.
        cycle: rows from one command to the next.
    """

    rows: np.ndarray
    earliest: np.ndarray
    latest: np.ndarray
    cycle: float


def steady_steps(values: np.ndarray) -> SteadySteps | None:
    """The changes of a command (T,), if one steady cycle explains the rows of all of them; else None.

    Cycles in which the command stays the same show no change, and may be any number.
    """
    rows = np.flatnonzero(np.diff(values)) + 1
    if len(rows) < FEWEST_CHANGES:
        return None
    gaps = np.diff(rows)
    usual = np.quantile(gaps, 0.5, method="nearest")
    single = gaps[np.abs(gaps - usual) <= 1.0]  # of a cycle of 2.5 rows, 2 and 3
    cycle = float(single.mean())
    for _ in range(_ROUNDS):
        if cycle < SHORTEST_CYCLE:
            return None
        number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(gaps / cycle), 1.0))])
        cycle = float(np.polyfit(number, rows, 1)[0])
    at = np.stack([number, np.ones(len(number))], axis=1)
    ends = []
    for sign in (1.0, -1.0):  # the earliest and the latest of all cycles that put each change between its rows
        found = linprog(
            sign * at.mean(axis=0),
            A_ub=np.concatenate([at, -at]),
            b_ub=np.concatenate([rows, 1.0 - rows]),
            bounds=[(None, None)] * 2,
        )
        if not found.success:
            return None
        ends.append(at @ found.x)
    return SteadySteps(rows, *ends, float(cycle))


def command_between(values: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Two curves of a command (T,) with so many samples from one row to the next, between which the true one lies.

    Returns:
        As late and as early as it may have come: with a steady cycle its steps at the latest and the earliest; else held
            until the next row, and on a smooth curve through the rows.
    """
    found = steady_steps(values) if steps > 1 else None
    if found is None:
        return held(values, steps), between(values, steps)
    known = np.concatenate([values[:1], values[found.rows]])
    sample = np.arange((len(values) - 1) * steps + 1)
    # Never in the row before, which does not show it.
    ends = np.ceil(steps * found.latest - _EXACT), np.floor(steps * found.earliest + _EXACT) + 1
    late, early = (known[np.searchsorted(changes, sample, side="right")] for changes in ends)
    return late, early
