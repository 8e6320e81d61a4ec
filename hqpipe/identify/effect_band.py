"""The frequencies at which the effects of a joint act.

A joint may vibrate at the resonance of its oil or of its load, faster than any effect acts. No free run predicts the phase of
that, so it stays in the errors, and no effect can have described a part of it by chance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.model import Samples

_HELD = 0.9  # of the square of what effects do that lies in their band; assumption: the rest is edges
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
        white = inside = 0.0
        for frequency, weight, _ in _powers(np.zeros(len(self.samples.trial)), self.samples):
            white, inside = white + weight.sum(), inside + weight[frequency <= self.highest].sum()
        return float(inside / white) if white else 1.0

    def square(self, error: np.ndarray) -> float:
        """Sum of the squares of that part of errors (N,) that lies in the band; infinite where a prediction overflows."""
        if not np.isfinite(error).all():
            return np.inf
        powers = _powers(error, self.samples)
        return float(sum(np.sum(power[frequency <= self.highest]) for frequency, _, power in powers))


def effect_band(change: np.ndarray, samples: Samples) -> EffectBand:
    """The band that holds most of what effects do beside a constant; all frequencies where they do nothing.

    Args:
        change: (N,) what they change in the errors.
    """
    if not np.isfinite(change).all():
        return EffectBand(samples, _FASTEST)
    powers = [(frequency[1:], power[1:]) for frequency, _, power in _powers(change, samples)]
    if not powers:
        return EffectBand(samples, _FASTEST)
    frequency, power = (np.concatenate(column) for column in zip(*powers, strict=True))
    order = np.argsort(frequency, kind="stable")
    below = np.cumsum(power[order])
    if not (len(below) and below[-1] > 0.0):
        return EffectBand(samples, _FASTEST)
    return EffectBand(samples, float(frequency[order][np.searchsorted(below, _HELD * below[-1])]))


def _powers(values: np.ndarray, samples: Samples) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each trial: frequencies (cycles a sample), how many of its numbers each stands for, and the square of its part."""
    for k in range(len(samples.files)):
        own = values[samples.trial == k]
        if not len(own):
            continue
        frequency = np.fft.rfftfreq(len(own))
        weight = np.where((frequency == 0.0) | (frequency == _FASTEST), 1.0, 2.0)
        yield frequency, weight, weight * np.abs(np.fft.rfft(own)) ** 2 / len(own)
