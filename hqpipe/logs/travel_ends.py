"""The ends of a joint's travel that hold it: stops that it rests on or hits, found from what is logged.

Near such a stop neither the position nor the force says anything of what drives the joint, so that no model is judged there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

HOLD_S, HOLD_ROWS = 0.1, 5
"""Least length of a rest at an end stop; shorter ones are turning points. assumption: as in hqpipe.logs.survey.end_stop."""
NEAR = 0.01  # of the travel, within which an end stop lies; assumption: its rubber or oil cushion gives by that much
CONTACT, CONTACT_NOISE = 0.002, 4.0  # of the travel, and of the sensor's noise, within which a joint touches its stop
STILL = 0.05  # of the usual speed: the joint stands; assumption: below what a loaded cylinder creeps
ARRIVALS = 2  # at the same place; assumption: a joint that stalls once may have met anything


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a log without gaps.

    Attributes:
        position: (T,). push: (T,) above 0 where the joint is driven towards higher positions by more than holds it in place,
            below 0 likewise; 0 where neither.
    """

    position: np.ndarray
    push: np.ndarray


@dataclass(frozen=True)
class TravelEnd:
    """An end of the travel that holds the joint.

    Attributes:
        position: from which on the joint touches it, unit of the position. upper: whether it is the upper end.
    """

    position: float
    upper: bool

    def touched(self, position: np.ndarray) -> np.ndarray:
        """(T,) whether a joint at these positions touches the stop."""
        return position >= self.position if self.upper else position <= self.position


def held_ends(
    stretches: Sequence[Stretch], dt: float, speed: float, noise: float, arrivals: int = ARRIVALS
) -> list[TravelEnd]:
    """The ends of the travel where a joint stands although it is driven on, repeatedly and in the same place.

    Args:
        stretches: of one joint, of all trials. dt: s. speed: usual speed of the joint where it moves, unit of the position per
            s. noise: standard deviation of the position's sensor. arrivals: how often it must have come to rest there.
    """
    span = max(HOLD_ROWS, round(HOLD_S / dt))
    highest, lowest = (float(pick([pick(s.position) for s in stretches])) for pick in (np.max, np.min))
    travel = highest - lowest
    found = []
    for side, end in ((1.0, highest), (-1.0, lowest)):
        rests = [part for s in stretches for part in _rests(s, side, end, NEAR * travel, span, STILL * speed * dt)]
        if len(rests) >= arrivals:
            innermost = min(float(np.median(side * part)) for part in rests)
            found.append(TravelEnd(side * (innermost - max(CONTACT_NOISE * noise, CONTACT * travel)), side > 0.0))
    return found


def _rests(s: Stretch, side: float, end: float, near: float, span: int, slow: float) -> list[np.ndarray]:
    """Positions of each rest near an end against which the joint is pushed.

    Args:
        near: unit of the position. span: samples of the shortest rest. slow: travel in a sample below which the joint stands.
    """
    index = np.arange(len(s.position))
    before, behind = np.maximum(index - span // 2, 0), np.minimum(index + (span + 1) // 2, len(index) - 1)
    moved = np.abs(s.position[behind] - s.position[before]) / np.maximum(behind - before, 1)
    held = (moved < slow) & (side * (end - s.position) < near) & (side * s.push > 0.0)
    return [s.position[a:b] for a, b in runs(held) if b - a >= span]


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Start and stop of each run of True. flags: (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
