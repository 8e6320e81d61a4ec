"""Joint velocity from positions."""

from __future__ import annotations

import numpy as np

_SPAN_S = 0.02  # assumption: −3 dB near 70 Hz at 1 kHz, above what a joint of a heavy machine follows
_MIN_SAMPLES = 7  # a cubic through fewer points follows the noise
_ORDER = 3


def differentiate(position: np.ndarray, dt: float) -> np.ndarray:
    """Zero-phase derivative: the slope of a cubic fitted to a centred window (Savitzky and Golay, 1964).

    Args:
        position: (T, J) rad; T is at least 7.
        dt: sample time, s.

    Returns:
        (T, J) rad/s, without delay; it looks half a window ahead, which a controller could not.
    """
    from scipy.signal import savgol_filter

    samples = max(_MIN_SAMPLES, int(round(_SPAN_S / dt)) | 1)
    longest = len(position) - 1 + len(position) % 2
    return savgol_filter(position, min(samples, longest), _ORDER, deriv=1, delta=dt, axis=0)


def window_s(dt: float) -> float:
    """Length of the window that `differentiate` uses, s."""
    return max(_MIN_SAMPLES, int(round(_SPAN_S / dt)) | 1) * dt


def step_speed(position: np.ndarray, dt: float) -> np.ndarray:
    """(T,) mean speed from each sample to the next, rad/s; its sum is the travel, whatever the encoder's resolution.

    Args:
        position: (T,) rad. dt: sample time, s.
    """
    return np.append(np.diff(position), position[-1] - position[-2]).astype(np.float64) / dt
