"""How fast a joint moves, how noisy its position is, and the cut-off frequency that follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SEGMENT_S = 4.0  # of a periodogram: frequencies 0.25 Hz apart, for machines that move at 0.5 Hz and above
WITHIN = 0.3  # of the sample rate, the highest cut-off: beyond it the difference quotient below errs by more than 3 %
NOISE_SHARE = (
    0.005  # of the variance of the acceleration that may be noise: errors in a regressor bias its coefficient by it
)
ABOVE_FLOOR = 2.0  # density over that of the noise up to the cut-off: the motion alone is then as large as the noise
GAP = 1.5  # between frequencies of the motion that follow each other; assumption: a joint's spectrum has no wider hole
GAP_BINS = 4  # of the spectrum, at least: the main lobe of the Hann window that `welch` takes
MOTION_ENERGY = 0.95  # of the variance of velocity or acceleration lies below its bandwidth; assumption
LEAST_OVER_BANDWIDTH = (
    5.0  # cut-off over the bandwidth of the velocity, where it stands above the noise: Gautier (1997)
)
MOST_OVER_BANDWIDTH = 20.0  # over that of the acceleration; assumption: reversals are that much sharper than the motion
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # central, sixth order: Fornberg (1988), table 1
ORDER = 4  # of the Butterworth filter, run forwards and backwards: Gautier (1997)


@dataclass(frozen=True)
class Bandwidth:
    """Attributes:
    cutoff: Hz, of the low-pass filter on the position.
    density: one-sided spectral density of the position's noise, rad²/Hz (m²/Hz).
    """

    cutoff: float
    density: float


def bandwidth(positions: Sequence[np.ndarray], dt: float) -> Bandwidth:
    """The cut-off frequency at which the acceleration holds the motion and next to no noise.

    The spectrum is that of the second difference, divided by the gain of the difference: so the large slow motion does not leak
    into the noise. White noise of the position is the median density in the upper half of the band. A motion at constant
    speeds, whose acceleration is in the noise, is still filtered at five times its own bandwidth, so that reversals stay sharp.

    Args:
        positions: (T,) of each trial, rad or m. dt: s.
    """
    frequency, density = _spectrum(positions, dt)
    floor = float(np.median(density[frequency >= 0.25 / dt]))
    usable = frequency <= WITHIN / dt
    if not np.any(density[usable] > floor):
        return Bandwidth(float(frequency[usable][-1]), floor)
    above = np.flatnonzero(np.convolve(density, np.ones(3) / 3.0, "same") >= ABOVE_FLOOR * floor)
    gaps = np.flatnonzero((frequency[above[1:]] > GAP * frequency[above[:-1]]) & (np.diff(above) > GAP_BINS))
    crossing = above[gaps[0]] if len(gaps) else above[-1] if len(above) else 0
    inside = usable & (np.arange(len(frequency)) <= crossing)
    last = int(np.flatnonzero(inside)[-1])
    excess = np.maximum(density - floor, 0.0)
    omega2 = (2.0 * np.pi * frequency) ** 2
    speed = np.cumsum(excess * omega2)
    acceleration, noise = np.cumsum(excess * omega2**2), np.cumsum(floor * omega2**2)
    clean = np.flatnonzero(inside & (noise <= NOISE_SHARE * acceleration) & (acceleration >= 0.5 * acceleration[last]))
    least = LEAST_OVER_BANDWIDTH * frequency[np.searchsorted(speed, MOTION_ENERGY * speed[last])]
    cutoff = max(frequency[clean[-1]] if len(clean) else 0.0, min(least, frequency[last]))
    reached = acceleration[np.searchsorted(frequency, cutoff)]
    moving = frequency[np.searchsorted(acceleration, MOTION_ENERGY * reached)]
    return Bandwidth(float(min(cutoff, MOST_OVER_BANDWIDTH * moving)), floor)


def _spectrum(positions: Sequence[np.ndarray], dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies above zero, Hz, and the one-sided density of the position over all trials."""
    from scipy.signal import welch

    size = min(max(64, round(SEGMENT_S / dt)), min(len(q) for q in positions) - 2)
    total, weight = 0.0, 0
    for q in positions:
        frequency, density = welch(np.diff(q, 2), 1.0 / dt, nperseg=size, detrend=False)
        total, weight = total + len(q) * density, weight + len(q)
    frequency = frequency[1:]
    return frequency, np.asarray(total)[1:] / weight / (2.0 * np.sin(np.pi * frequency * dt)) ** 4


def low_passed(values: np.ndarray, dt: float, cutoff: float) -> np.ndarray:
    """(T,) without delay: Butterworth, forwards and backwards."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(ORDER, min(cutoff * dt * 2.0, 0.99), output="sos")
    return sosfiltfilt(sos, values, padlen=min(len(values) - 1, max(30, round(2.0 / (cutoff * dt)))))


def derivative(values: np.ndarray, dt: float) -> np.ndarray:
    """(T,) central difference of sixth order; the three samples at each end by lower orders."""
    found = np.gradient(values, dt)
    found[3:-3] = np.convolve(values, DIFFERENCE[::-1], "valid") / dt
    return found


def passed_noise(noise: Bandwidth, dt: float, kernel: np.ndarray, order: int) -> float:
    """Root mean square of the position's noise in a derivative after both filters, rad/s^order.

    Args:
        kernel: (L,) weights of the second filter; [1.0] for none. order: 0 position, 1 velocity, 2 acceleration.
    """
    frequency = np.linspace(0.0, 0.5 / dt, 513)[1:]
    response = np.abs(np.exp(-2j * np.pi * np.outer(frequency * dt, np.arange(len(kernel)))) @ kernel)
    low = 1.0 / (1.0 + (np.tan(np.pi * frequency * dt * 0.999) / np.tan(np.pi * noise.cutoff * dt)) ** (2 * ORDER))
    gain = (2.0 * np.pi * frequency) ** order * low * response
    return float(np.sqrt(noise.density * np.sum(gain**2) * (frequency[1] - frequency[0])))


def noise_density(values: Sequence[np.ndarray], dt: float, low: float, high: float) -> float:
    """One-sided spectral density of a channel between two frequencies, by the median; unit² / Hz."""
    from scipy.signal import welch

    total, weight = 0.0, 0
    size = min(max(64, round(SEGMENT_S / dt)), min(len(v) for v in values))
    for channel in values:
        frequency, density = welch(channel, 1.0 / dt, nperseg=size)
        total, weight = total + len(channel) * density, weight + len(channel)
    inside = (frequency >= low) & (frequency <= high)
    return float(np.median(np.asarray(total)[inside])) / weight if inside.any() else 0.0
