"""What sensor noise leaves in the error of a perfect model."""

from __future__ import annotations

import numpy as np

from hqpipe.layers.valve.masks import runs
from hqpipe.layers.valve.record import Record, Scales
from hqpipe.logs.survey.signal import difference_noise, resolution

REST_S = 0.5  # of a rest that tells a sensor's noise; assumption: longer than the joint takes to stop
LEFT_ALONE = 0.02  # of the command's largest distance from rest; assumption
FEWEST = 10  # samples of a rest; assumption


def sensor_noise(values: np.ndarray, record: Record, scales: Scales) -> float:
    """Standard deviation of the noise of a sensor of the joint, its quantisation included.

    The scatter about a straight line while the joint is left alone, where there are such rests; else what differences leave
    of it in the calmest parts of the logs. At least that of rounding to the sensor's step: √(1/12) of it (Bennett 1948).

    Args:
        values: (N,) of the position or the velocity.
    """
    step = resolution(values) or resolution(kept(values))
    rounding = (step or 0.0) / np.sqrt(12.0)
    alone = (np.abs(record.command - scales.rest) <= LEFT_ALONE * scales.command) & record.observed
    settle = max(round(REST_S / record.dt), 1)
    scatter = []
    for start, stop in runs(alone, record.stretch):
        part = values[start + settle : stop]
        if len(part) >= FEWEST:
            line = np.polynomial.polynomial.polyfit(np.linspace(-1.0, 1.0, len(part)), part, 1)
            rest = part - np.polynomial.polynomial.polyval(np.linspace(-1.0, 1.0, len(part)), line)
            scatter.append(float(np.sqrt(rest @ rest / (len(part) - 2))))
    if scatter:
        return max(float(np.median(scatter)), rounding)
    stretches = [values[first : last + 1] for first, last in zip(record.first, record.last, strict=True)]
    return max(difference_noise(stretches), rounding)


def kept(values: np.ndarray) -> np.ndarray:
    """The values that two samples in a row have: of a rounded signal that was brought to another clock by interpolation, those
    that the sensor really gave."""
    return values[1:][values[1:] == values[:-1]]
