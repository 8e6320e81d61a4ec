"""The noise of a sensor, from its signal alone: how small the error of a prediction could be at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from hqpipe.logs.survey.signal import difference_noise, noise, resolution
from hqpipe.logs.trajectory import Trial

PIECE = 400  # samples; assumption: long enough to tell white noise, short enough to lie between two impacts


def white_noise(pieces: Iterable[tuple[np.ndarray, float | None]]) -> float | None:
    """Standard deviation of the white noise in most pieces of a signal, the median over them; None where most show none.

    Args:
        pieces: of about `PIECE` samples, each with the step of its sensor, see `hqpipe.logs.survey.signal.resolution`.
    """
    found = [noise(values, step) for values, step in pieces]
    known = [value for value in found if value is not None]
    return float(np.median(known)) if 2 * len(known) > len(found) else None


def sensor_noise(signals: Sequence[np.ndarray]) -> float:
    """Standard deviation of the noise of a sensor: white in most pieces of its signals, else what differences leave, in which
    some of the motion is left too.

    Args:
        signals: (T,) of each trial.
    """
    most = float(np.sqrt(np.mean([difference_noise(signal) ** 2 for signal in signals])))
    steps = [resolution(signal) for signal in signals]
    white = white_noise(
        (signal[at : at + PIECE], step)
        for signal, step in zip(signals, steps, strict=True)
        for at in range(0, len(signal) - PIECE + 1, PIECE)
    )
    return most if white is None else min(most, white)


def torque_noise(trials: Sequence[Trial], joint: str) -> float:
    """Standard deviation of the noise of one joint's measured torque over some trials, N·m."""
    j = trials[0].trajectory.joint(joint)
    return sensor_noise([trial.trajectory.effort[:, j] for trial in trials])
