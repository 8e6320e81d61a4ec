"""Positions that start again after a full turn, as absolute encoders report them."""

from __future__ import annotations

import numpy as np

TURN = 2.0 * np.pi
_LEAST_JUMP = 0.8  # turns; assumption: a joint moves by less than a fifth of a turn between two samples
_ROOM = 1.01  # turns that a wrapped signal lies within; noise takes it beyond one


def jumps(position: np.ndarray) -> np.ndarray:
    """(T,) whole turns that each sample lies behind the first one; all 0 where the position does not wrap.

    A jump of nearly a turn from one sample to the next is a wrap where the whole signal stays within one turn.

    Args:
        position: (T,) rad, NaN where missing.
    """
    found = np.zeros(len(position))
    present = np.flatnonzero(np.isfinite(position))
    values = position[present]
    if len(values) < 2 or np.ptp(values) > _ROOM * TURN:
        return found
    steps = np.diff(values) / TURN
    turns = np.where(np.abs(steps) > _LEAST_JUMP, -np.sign(steps), 0.0)
    found[present[1:]] = turns
    return np.cumsum(found)


def nearest_turn(command: np.ndarray, position: np.ndarray) -> np.ndarray:
    """A commanded angle in the turn in which it is nearest to the position.

    Args:
        command, position: (T,) rad.
    """
    turns = np.round((position - command) / TURN)
    return command + TURN * np.where(np.isfinite(turns), turns, 0.0)
