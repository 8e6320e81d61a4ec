"""How small a torque error could be at all: the noise of the torque signal itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.logs.survey.signal import block_rms, difference_noise
from hqpipe.logs.trajectory import Trial

_AR_ORDER = 20
_AR_SAMPLES = 10_000  # of the start of a trial; plenty for 20 coefficients


@dataclass(frozen=True)
class NoiseFloor:
    """Standard deviation of the torque noise of one joint, N·m.

    Attributes:
        differencing: from differences of order 1 … 8 (a smooth signal vanishes in them, white noise stays).
        innovation: what an autoregression of order 20 cannot predict from the torque's own past.
    """

    differencing: float
    innovation: float

    @property
    def value(self) -> float:
        """The smaller estimate: each is an upper bound for white noise."""
        return min(self.differencing, self.innovation)


def innovation_noise(signal: np.ndarray) -> float:
    """RMS of what a linear autoregression of the (T,) signal leaves over."""
    signal = signal[:_AR_SAMPLES] - signal[:_AR_SAMPLES].mean()
    order = min(_AR_ORDER, len(signal) // 10)
    past = np.lib.stride_tricks.sliding_window_view(signal, order)[:-1]
    future = signal[order:]
    coefficients = np.linalg.lstsq(past.T @ past, past.T @ future, rcond=1e-14)[0]
    return block_rms(future - past @ coefficients)


def noise_floor(trials: list[Trial], joint: str) -> NoiseFloor:
    """Noise floor of one joint's torque over some trials.

    Args:
        trials: with effort. joint: name.
    """
    trajectories = [trial.trajectory for trial in trials]
    j = trajectories[0].joint(joint)
    signals = [t.effort[:, j] for t in trajectories]
    weights = np.array([len(s) for s in signals], dtype=float)

    def pooled(estimate) -> float:
        return float(np.sqrt(np.average([estimate(s) ** 2 for s in signals], weights=weights)))

    return NoiseFloor(pooled(difference_noise), pooled(innovation_noise))
