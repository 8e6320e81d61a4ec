"""What sensor noise leaves in the error of a perfect model of a force loop."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.torque.record import Record
from hqpipe.logs.survey.signal import difference_noise, noise, resolution
from hqpipe.logs.travel_ends import runs

_PIECE = 400  # samples; assumption: long enough to tell white noise, short enough to lie between two impacts


def error_noise(record: Record, rate: float, speed_share: float) -> float:
    """Root mean square that noise of the effort and the velocity leaves, in the unit of the effort.

    The noise of the velocity passes the loop, a first-order low-pass, before it shows in the predicted effort.

    Args:
        rate: 1/s, of the loop. speed_share: unit of the effort per speed.
    """
    if not len(record.effort):
        return 0.0
    effort = difference_noise([record.effort[a:b] for a, b in _free(record)])
    white = _white(record.velocity, record)
    if white is None:  # as of a velocity that is derived from the position, whose errors cancel in the loop
        return effort
    step = rate * record.dt
    passed = abs(speed_share) * step / np.sqrt(1.0 - np.exp(-2.0 * step))
    return float(np.hypot(effort, passed * white))


def _white(values: np.ndarray, record: Record) -> float | None:
    """Standard deviation of white noise, the median over the pieces that show some; None where most show none."""
    step = resolution(values)
    starts = [at for a, b in _free(record) for at in range(a, b - _PIECE + 1, _PIECE)]
    found = [noise(values[at : at + _PIECE], step) for at in starts]
    known = [value for value in found if value is not None]
    return float(np.median(known)) if 2 * len(known) > len(found) else None


def _free(record: Record) -> list[tuple[int, int]]:
    """(first, stop) of the stretches without masked samples."""
    return [
        (int(first) + a, int(first) + b)
        for first, last in zip(record.first, record.last, strict=True)
        for a, b in runs(~record.masked[first : last + 1])
    ]
