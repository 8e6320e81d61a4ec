"""Joints that stand at an end stop while their command goes on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.trajectory import Trajectory

_HOLD_S, _HOLD_ROWS = 0.1, 5  # of one stretch; assumption: shorter ones are the turning points of a motion
_STRETCHES = 2  # at the same value; assumption: a joint that stalls once may have met anything
_NEAR = 2e-3  # of the travel, within which a joint stands still
_BEYOND = 0.2  # of the travel, that the command goes beyond it; dry friction holds a joint within less; assumption
_MOVES = 0.1  # of the travel, by which the command moves meanwhile; else it may be the load that holds the joint
_FOLLOWS = 0.5  # of how far the command goes beyond: the error that the joint shows elsewhere; assumption


@dataclass(frozen=True)
class EndStop:
    """A joint at its end stop.

    Attributes:
        joint: its name. position: where it stands, rad. beyond: how far the command goes on, rad. files: trials.
    """

    joint: str
    position: float
    beyond: float
    files: tuple[str, ...]


def end_stops(trials: Sequence[tuple[str, Trajectory]]) -> list[EndStop]:
    """Joints that repeatedly stand at one end of their travel while a position command moves on beyond it.

    Args:
        trials: (file, trajectory) with the same joints; those without a position command say nothing.
    """
    known = [(file, t) for file, t in trials if t.position_command is not None]
    found = []
    for j, joint in enumerate(known[0][1].joints if known else ()):
        for side in (1.0, -1.0):
            signals = [(file, t.dt, side * t.position[:, j], side * t.position_command[:, j]) for file, t in known]
            if stop := _at_upper_end(signals):
                position, beyond, files = stop
                found.append(EndStop(joint, side * position, beyond, files))
    return found


def _at_upper_end(
    signals: Sequence[tuple[str, float, np.ndarray, np.ndarray]],
) -> tuple[float, float, tuple[str, ...]] | None:
    """Position, largest distance of the command beyond it and files, of (file, dt, position, command)."""
    top = max(float(q.max()) for _, _, q, _ in signals)
    travel = top - min(float(q.min()) for _, _, q, _ in signals)
    if travel == 0.0:
        return None  # a constant position, which is found as such
    stretches, elsewhere = [], []
    for file, dt, q, c in signals:
        standing = (q >= top - _NEAR * travel) & (c > q)
        elsewhere.append(np.abs(c - q)[~standing])
        edges = np.flatnonzero(np.diff(np.concatenate(([0], standing.astype(np.int8), [0]))))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            part = c[start:stop]
            long = stop - start >= max(_HOLD_ROWS, _HOLD_S / dt)
            if long and part.max() - top > _BEYOND * travel and np.ptp(part) > _MOVES * travel:
                stretches.append((file, float(part.max() - top)))
    if len(stretches) < _STRETCHES:
        return None
    beyond = max(size for _, size in stretches)
    rest = np.concatenate(elsewhere)
    if len(rest) and np.quantile(rest, 0.95) > _FOLLOWS * beyond:
        return None
    return top, beyond, tuple(dict.fromkeys(file for file, _ in stretches))
