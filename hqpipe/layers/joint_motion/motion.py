"""Position, velocity and acceleration of one joint in one trial, and the filter that torque and regressors pass alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import Bandwidth, derivative, low_passed, passed_noise

REST_NOISE = 3.0  # standard deviations of the velocity's noise: a joint slower than that may stand still
REST_COUNT = 0.5  # of one count of the encoder in one period of the cut-off, likewise
PER_PERIOD = 4  # samples kept in one length of the filter: half the Nyquist rate of what it passes


@dataclass(frozen=True, eq=False)
class Motion:
    """Attributes:
    position, velocity, acceleration: (T,) rad, rad/s, rad/s² (m, …), low-passed.
    rest: (T,) whether the joint may stand still. direction: (T,) −1 … 1, the sign of the velocity, linear where it may rest.
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    rest: np.ndarray
    direction: np.ndarray


def motion_of(position: np.ndarray, dt: float, cutoff: float, rest_speed: float) -> Motion:
    """Filtered motion of one joint: Butterworth without delay, central differences (Gautier 1997).

    Args:
        position: (T,) as logged. cutoff: Hz. rest_speed: see `rest_speed`.
    """
    q = low_passed(position, dt, cutoff)
    v = derivative(q, dt)
    direction = np.clip(v / rest_speed, -1.0, 1.0) if rest_speed > 0.0 else np.sign(v)
    return Motion(q, v, derivative(v, dt), np.abs(v) < rest_speed, direction)


def rest_speed(noise: Bandwidth, dt: float, count: float) -> float:
    """Speed below which the log cannot tell motion from rest, rad/s (m/s).

    Args:
        count: resolution of the position, see `resolution`.
    """
    return max(REST_NOISE * passed_noise(noise, dt, np.ones(1), 1), REST_COUNT * count * noise.cutoff)


def resolution(position: np.ndarray) -> float:
    """Smallest step between neighbouring values of a (T,) channel; 0 for a constant one."""
    values = np.unique(position)
    steps = np.diff(values)
    top = float(np.ptp(position))
    steps = steps[steps > 1e-9 * top]  # assumption: less is the rounding of the file
    return float(np.min(steps)) if len(steps) else 0.0


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """Weighted means over a sliding window, of which every `step`-th is kept: the parallel decimation of Gautier (1997).

    A Hann window of length 1/cut-off: −6 dB there, no negative weights, so that no sample outside the window counts.

    Attributes:
        weights: (L,) of sum 1. step: samples.
    """

    weights: np.ndarray
    step: int

    @classmethod
    def of(cls, cutoff: float, dt: float) -> ParallelFilter:
        """For a cut-off in Hz."""
        half = max(0, round(0.5 / (cutoff * dt)) - 1)
        weights = np.hanning(2 * half + 3)[1:-1]
        return cls(weights / weights.sum(), max(1, round(1.0 / (PER_PERIOD * cutoff * dt))))

    @property
    def length(self) -> int:
        return len(self.weights)

    def centres(self, samples: int) -> np.ndarray:
        """Indices of the samples at the middle of the windows that lie within a trial of `samples`."""
        return np.arange(self.length // 2, samples - self.length // 2, self.step)

    def apply(self, rows: np.ndarray) -> np.ndarray:
        """(…, T) → (…, N) at `centres`."""
        from scipy.signal import upfirdn

        if self.length == 1:
            return rows[..., :: self.step]
        ahead = (1 - self.length) % self.step  # zeros in front, so that the first whole window is one of those kept
        padded = np.concatenate([np.zeros((*rows.shape[:-1], ahead)), rows], axis=-1)
        found = upfirdn(self.weights, padded, down=self.step, axis=-1)
        first = (self.length - 1 + ahead) // self.step
        return found[..., first : first + len(self.centres(rows.shape[-1]))]
