"""Figures of one sampled signal: the step of its sensor, its noise, how long each value is held."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

_SINGLE = float(np.finfo(np.float32).eps)  # logs are often stored in single precision
_MIN_STEPS = 20  # changes of the value; assumption: with fewer neither a step nor a period can be told
_ON_GRID = 0.1  # of a step, within which a change is a multiple of it
_GRID_SHARE = 0.95  # of the changes that must be multiples; of a continuous signal a fifth are
_FAR = 50  # steps; the rounding of larger changes adds up
_WHITE = (-0.75, 0.3, -0.05)  # correlation of third differences of white noise 1, 2 and 3 samples apart
_LIKE_WHITE = 0.1  # deviation from these; assumption
_MEDIAN_SQUARE = 0.455  # median of the square of a standard normal number
_THIRD = 20.0  # variance of the third difference of white noise of variance 1: 1 + 9 + 9 + 1
_REST = 50  # samples; a longer run of one value is a rest
_SINGLE_SHARE = 0.3  # of the runs; with more runs of one sample the value is not held; assumption
_JUMP = 3.0  # steps of the sensor; smaller changes are those of a slow signal

_PIECE = 30  # samples; assumption: long enough to tell a variance to a third, short enough to lie between two motions
_CALMEST = 0.1  # of the pieces: the machine rests, or moves slowly, a tenth of the time; assumption
_ORDERS = range(1, 9)  # of differences


def resolution(values: np.ndarray) -> float | None:
    """One step of a quantised signal (T,), in its unit; None where it has no step, or too few changes to tell."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 4.0 * _SINGLE * np.abs(values).max(initial=0.0)]
    if len(changes) < _MIN_STEPS:
        return None
    rank = len(changes) // 1000  # a few odd changes, as at a clipped peak, do not count
    step = float(np.partition(changes, rank)[rank])
    ratio = changes[changes < _FAR * step] / step
    step *= float(np.median(ratio / np.maximum(np.round(ratio), 1.0)))  # the smallest change is off by its own rounding
    ratio = changes[changes < _FAR * step] / step
    on_grid = len(ratio) >= _MIN_STEPS and np.mean(np.abs(ratio - np.round(ratio)) < _ON_GRID) >= _GRID_SHARE
    return step if on_grid else None


def noise(values: np.ndarray, step: float | None) -> float | None:
    """Standard deviation of the white noise on a signal (T,), from its third differences.

    Differences remove what is smooth. Where what they leave is not white, as with motion that the rate hardly resolves, or is
    no larger than a step of the sensor, the noise cannot be told.

    Args:
        values: (T,). step: as of `resolution`.

    Returns:
        In the unit of the signal, or None.
    """
    third = np.diff(values, 3)
    power = float(third @ third)
    if len(third) < _MIN_STEPS or power == 0.0:
        return None
    sigma = float(np.sqrt(np.median(third**2) / _MEDIAN_SQUARE / _THIRD))
    white = all(
        abs(float(third[lag:] @ third[:-lag]) / power - expected) < _LIKE_WHITE
        for lag, expected in enumerate(_WHITE, 1)
    )
    floor = max(step or 0.0, 2.0 * _SINGLE * float(np.abs(values).max()))
    return sigma if white and sigma > floor else None


def held(values: np.ndarray, step: float | None) -> int | None:
    """Samples for which a changing signal (T,) keeps each value, if that is more than one: its source is slower than the clock.

    Args:
        values: (T,). step: as of `resolution`; a signal that creeps from one step of its sensor to the next is not held.
    """
    at = np.flatnonzero(np.diff(values) != 0.0)
    runs = np.diff(at)
    runs = runs[runs <= _REST]
    if len(runs) < _MIN_STEPS or np.mean(runs == 1) > _SINGLE_SHARE:
        return None
    jump = float(np.median(np.abs(np.diff(values)[at])))
    length = int(np.median(runs))
    return length if length > 1 and (step is None or jump >= _JUMP * step) else None


def difference_noise(signals: Sequence[np.ndarray]) -> float:
    """Standard deviation of the noise of a sensor, from what differences leave of its signals.

    The difference of order n of white noise has the variance σ² · C(2n, n), and of smooth motion little is left. Where a log is
    slow, or motion rough, that holds for the calmest pieces only: so the calmest tenth of them tells, corrected for what that
    tenth would show of white noise (minimum statistics, Martin 2001), with the order that leaves least; or `noise` of the
    signals that show some, if that is less. At least the rounding to the sensor's step: √(1/12) of it (Bennett 1948).

    Args:
        signals: (T,) each, of one sensor without a gap in time.
    """
    step = resolution(np.concatenate([np.zeros(0), *signals]))
    white = [sigma for signal in signals if (sigma := noise(signal, step)) is not None]
    orders = [order for order in _ORDERS if any(len(signal) > 2 * order for signal in signals)]
    found = [_calm_rms(signals, order) for order in orders] + ([float(np.median(white))] if white else [])
    return max(min(found, default=0.0), (step or 0.0) / np.sqrt(12.0))


def _calm_rms(signals: Sequence[np.ndarray], order: int) -> float:
    """Standard deviation of white noise with such differences in the calmest pieces; 0 where nothing ever changes."""
    from scipy.special import chdtri

    differences = [np.diff(signal, order) for signal in signals]
    size = min(_PIECE, max(len(difference) for difference in differences))
    whole_pieces = [difference[: len(difference) // size * size].reshape(-1, size) for difference in differences]
    squares = np.mean(np.concatenate(whole_pieces) ** 2, axis=1)
    squares = squares[squares > 0.0]  # where a coarse sensor shows no change at all, it says nothing of its noise
    if not len(squares):
        return 0.0
    whole = comb(2 * order, order)
    alike = sum((comb(2 * order, order + lag) / whole) ** 2 for lag in range(-order, order + 1))
    freedom = size / alike  # independent ones among the differences of a piece
    expected = float(chdtri(freedom, 1.0 - _CALMEST)) / freedom
    return float(np.sqrt(np.quantile(squares, _CALMEST) / expected / whole))
