"""Positions that start again at the end of their encoder's range, as absolute encoders report them."""

from __future__ import annotations

import numpy as np

TURN = 2.0 * np.pi
_LEAST_JUMP = 0.8  # of the range; assumption: a joint moves by less than a fifth of it between two samples
_ROOM = 1.01  # ranges that a wrapped signal lies within; noise takes it beyond one
_LEAST_JUMPS = 2  # in each direction, or in one where a speed denies the jumps; assumption: one alone may be a fault
_BESIDE = 3  # steps on either side of a jump that tell how fast the joint moves there; assumption: noise averages out
_STEADY = 0.5  # of the speed on one side that the other has at least; assumption: it changes little in a few samples
_GAP = 2.0  # usual steps of the clock; a longer one lacks samples, and anything may have happened in it
_GOES_WITH = 0.8  # correlation of a speed with the steps of the position from which it tells them; assumption


def encoder_range(time: np.ndarray, position: np.ndarray, speed: np.ndarray | None = None) -> float | None:
    """Range, rad, at whose end the position starts again; None where it does not.

    A full turn is one where the whole signal stays within it and jumps by nearly as much. Any other range has to show in the
    signal itself: jumps of one size across all of it, each from one sample to the next, against a motion that goes on with the
    same speed behind them, and no other step that comes near. They go both ways, or a measured speed knows nothing of them.

    Args:
        time: (T,) s. position: (T,) rad, NaN where missing. speed: (T,) as measured, in any unit and of either sign.
    """
    present = np.flatnonzero(np.isfinite(position))
    values = position[present]
    if len(values) < 2:
        return None
    if np.ptp(values) <= _ROOM * TURN and (np.abs(np.diff(values)) > _LEAST_JUMP * TURN).any():
        return TURN
    return _range_shown(time[present], values, None if speed is None else speed[present])


def jumps(position: np.ndarray, size: float = TURN) -> np.ndarray:
    """(T,) whole ranges that each sample lies behind the first one; all 0 where the position does not wrap.

    Args:
        position: (T,) rad, NaN where missing. size: of the range, rad.
    """
    found = np.zeros(len(position))
    present = np.flatnonzero(np.isfinite(position))
    values = position[present]
    if len(values) < 2 or np.ptp(values) > _ROOM * size:
        return found
    steps = np.diff(values) / size
    found[present[1:]] = np.where(np.abs(steps) > _LEAST_JUMP, -np.sign(steps), 0.0)
    return np.cumsum(found)


def nearest_turn(command: np.ndarray, position: np.ndarray, size: float = TURN) -> np.ndarray:
    """A commanded angle in the range in which it is nearest to the position.

    Args:
        command, position: (T,) rad. size: of the range, rad.
    """
    turns = np.round((position - command) / size)
    return command + size * np.where(np.isfinite(turns), turns, 0.0)


def in_words(size: float) -> str:
    """A range, rad, for a message."""
    return "a turn" if size == TURN else f"{size:.4g} rad"


def _range_shown(time: np.ndarray, values: np.ndarray, speed: np.ndarray | None) -> float | None:
    """The range, rad, that the jumps of a signal without missing samples show."""
    steps, passed = np.diff(values), np.diff(time)
    whole = passed <= _GAP * np.median(passed)
    far = np.abs(steps) > _LEAST_JUMP * np.ptp(values)
    at = np.flatnonzero(far & whole)
    at = at[(at >= _BESIDE) & (at < len(steps) - _BESIDE)]
    if len(at) < _LEAST_JUMPS or (np.diff(at) <= _BESIDE).any():
        return None
    beside = at[:, None] + np.arange(1, _BESIDE + 1), at[:, None] - np.arange(1, _BESIDE + 1)
    after, before = (steps[rows].sum(axis=1) / passed[rows].sum(axis=1) for rows in beside)
    moved = 0.5 * (before + after) * passed[at]
    sizes = np.abs(moved - steps[at])
    size = float(np.median(sizes))
    near = np.abs(steps[whole & ~far]).max(initial=0.0) > (1.0 - _LEAST_JUMP) * size
    if near or np.ptp(values) > _ROOM * size:
        return None
    ways = np.sign(steps[at])
    steady = np.minimum(np.abs(before), np.abs(after)) > _STEADY * np.maximum(np.abs(before), np.abs(after))
    alike = np.abs(sizes - size) < np.abs(moved) + (_ROOM - 1.0) * size
    clear = alike & steady & (np.sign(before) == -ways) & (np.sign(after) == -ways)
    along = (np.sign(before) == ways) & (np.sign(after) == ways)
    told = None if speed is None else _told(steps, passed, whole & ~far, at, speed)
    shown = told is not None and (np.abs(told - steps[at]) < 0.5 * np.abs(steps[at])).any()  # nearer to it than to none
    if along.any() or shown:
        return None
    up, down = (int((ways[clear] == way).sum()) for way in (1, -1))
    least = max(up, down) if told is not None else min(up, down)
    return size if least >= _LEAST_JUMPS else None


def _told(
    steps: np.ndarray, passed: np.ndarray, usual: np.ndarray, at: np.ndarray, speed: np.ndarray
) -> np.ndarray | None:
    """(N,) steps in the rows `at`, rad, as a measured speed tells them; None where it does not go with the usual ones."""
    travel = 0.5 * (speed[1:] + speed[:-1]) * passed
    usual = usual & np.isfinite(travel)
    x, y = travel[usual], steps[usual]
    power = np.sqrt((x @ x) * (y @ y))
    if power == 0.0 or abs(x @ y) < _GOES_WITH * power or not np.isfinite(travel[at]).all():
        return None
    return travel[at] * (x @ y) / (x @ x)
