"""How small a torque error could be at all: the noise of the torque signal itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from hqpipe.logs.trajectory import Trial

_BLOCK = 100  # samples; the median over blocks sets impacts apart from noise
_ORDERS = range(1, 9)
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


def _block_rms(values: np.ndarray) -> float:
    """Of the median block; one in which a coarse sensor shows no change at all says nothing of its noise."""
    size = min(_BLOCK, len(values))
    blocks = values[: len(values) // size * size].reshape(-1, size)
    squares = np.mean(blocks**2, axis=1)
    changing = squares[squares > 0.0]
    return float(np.sqrt(np.median(changing))) if len(changing) else 0.0


def difference_noise(signal: np.ndarray) -> float:
    """Noise of a (T,) signal; the difference of order n of white noise has the variance σ² · C(2n, n)."""
    orders = [n for n in _ORDERS if len(signal) > 2 * n]
    return min(_block_rms(np.diff(signal, n)) / comb(2 * n, n) ** 0.5 for n in orders)


def innovation_noise(signal: np.ndarray) -> float:
    """RMS of what a linear autoregression of the (T,) signal leaves over."""
    signal = signal[:_AR_SAMPLES] - signal[:_AR_SAMPLES].mean()
    order = min(_AR_ORDER, len(signal) // 10)
    past = np.lib.stride_tricks.sliding_window_view(signal, order)[:-1]
    future = signal[order:]
    coefficients = np.linalg.lstsq(past.T @ past, past.T @ future, rcond=1e-14)[0]
    return _block_rms(future - past @ coefficients)


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
