"""The frequencies at which the effects of a joint act.

A joint may vibrate at the resonance of its oil or of its load, faster than any effect acts. No free run predicts the phase of
that, so it stays in the errors, and no effect can have described a part of it by chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import periodogram

from hqpipe.identify.model import Samples
from hqpipe.identify.thresholds import WITHIN_BAND

_FASTEST = 0.5  # cycles a sample


@dataclass(frozen=True, eq=False)
class EffectBand:
    """From rest to a highest frequency.

    Attributes:
        samples: of the errors. highest: cycles a sample.
    """

    samples: Samples
    highest: float

    @property
    def share(self) -> float:
        """Of white noise that lies in the band."""
        return self.highest / _FASTEST

    def square(self, error: np.ndarray) -> float:
        """Sum of the squares of that part of errors (N,) that lies in the band; infinite where a prediction overflows."""
        if not np.isfinite(error).all():
            return np.inf
        powers = _powers(error, self.samples)
        return float(sum(np.sum(power[frequency <= self.highest]) for frequency, power in powers))


def effect_band(change: np.ndarray, samples: Samples) -> EffectBand:
    """The band that holds most of what effects do beside a constant; all frequencies where they do nothing.

    Args:
        change: (N,) what they change in the errors.
    """
    if not np.isfinite(change).all():
        return EffectBand(samples, _FASTEST)
    powers = [(frequency[1:], power[1:]) for frequency, power in _powers(change, samples)]
    if not powers:
        return EffectBand(samples, _FASTEST)
    frequency, power = (np.concatenate(column) for column in zip(*powers, strict=True))
    order = np.argsort(frequency, kind="stable")
    below = np.cumsum(power[order])
    if not (len(below) and below[-1] > 0.0):
        return EffectBand(samples, _FASTEST)
    return EffectBand(samples, float(frequency[order][np.searchsorted(below, WITHIN_BAND * below[-1])]))


def square_above(error: np.ndarray, band: EffectBand, floor: float) -> float:
    """Sum of the squares of that part of errors (N,) which is above the band and above the noise; 0 where a prediction
    overflows.

    Args:
        floor: sum of the squares of the noise at all frequencies, which is white.
    """
    if not np.isfinite(error).all():
        return 0.0
    return max(float(error @ error) - band.square(error) - floor * (1.0 - band.share), 0.0)


def _powers(values: np.ndarray, samples: Samples) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each trial: frequencies, cycles a sample, and the part of the sum of squares at each."""
    for k in range(len(samples.files)):
        own = values[samples.trial == k]
        if len(own):
            frequency, mean_square = periodogram(own, detrend=False, scaling="spectrum")
            yield frequency, len(own) * mean_square
