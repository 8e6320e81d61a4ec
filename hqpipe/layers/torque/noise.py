"""What sensor noise leaves in the error of a perfect model of a force loop."""

from __future__ import annotations

import numpy as np

from hqpipe.identify.noise import PIECE, white_noise
from hqpipe.layers.torque.record import Record
from hqpipe.logs.survey.signal import resolution
from hqpipe.logs.travel_ends import runs

QUIET, QUIETEST = 20, 0.25
"""Samples of a piece, and quantile of the pieces that is taken for free of motion; assumption."""
SHARE = 0.66
"""That quantile of the mean square of 20 third differences of white noise, over their variance; from 200,000 drawn pieces."""
THIRD = 20.0  # variance of the third difference of white noise of variance 1: 1 + 9 + 9 + 1


def error_noise(record: Record, rate: float, speed_share: float) -> float:
    """Root mean square that noise of the effort and the velocity leaves, in the unit of the effort.

    The noise of the velocity passes the loop, a first-order low-pass, before it shows in the predicted effort.

    Args:
        rate: 1/s, of the loop. speed_share: unit of the effort per speed.
    """
    if not len(record.effort):
        return 0.0
    effort = _sensor_noise(record.effort, record)
    white = _white(record.velocity, record)
    if white is None:  # as of a velocity that is derived from the position, whose errors cancel in the loop
        return effort
    step = rate * record.dt
    passed = abs(speed_share) * step / np.sqrt(1.0 - np.exp(-2.0 * step))
    return float(np.hypot(effort, passed * white))


def _sensor_noise(values: np.ndarray, record: Record) -> float:
    """Standard deviation of the noise of a sensor, its quantisation included: √(1/12) of a step (Bennett 1948)."""
    rounding = (resolution(values) or 0.0) / np.sqrt(12.0)
    white = _white(values, record)
    if white is not None:
        return max(white, rounding)
    third = [np.diff(values[a:b], 3)[: (b - a - 3) // QUIET * QUIET] for a, b in _free(record) if b - a >= QUIET + 3]
    squares = np.mean(np.concatenate(third).reshape(-1, QUIET) ** 2, axis=1) / THIRD if third else np.zeros(0)
    return max(float(np.sqrt(np.quantile(squares, QUIETEST) / SHARE)) if len(squares) else 0.0, rounding)


def _white(values: np.ndarray, record: Record) -> float | None:
    """Standard deviation of white noise, or None where most pieces show none."""
    step = resolution(values)
    return white_noise(
        (values[at : at + PIECE], step) for a, b in _free(record) for at in range(a, b - PIECE + 1, PIECE)
    )


def _free(record: Record) -> list[tuple[int, int]]:
    """(first, stop) of the stretches without masked samples."""
    return [
        (int(first) + a, int(first) + b)
        for first, last in zip(record.first, record.last, strict=True)
        for a, b in runs(~record.masked[first : last + 1])
    ]
