"""How long the errors of a fit stay alike."""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len

from hqpipe.identify.model import Samples

_DIED = 0.05  # autocorrelation below which the sum ends: later lags add noise


@np.errstate(over="ignore", invalid="ignore")  # squares of an error that grows without bounds
def correlation_time(error: np.ndarray, samples: Samples) -> float:
    """Samples over which errors are alike: 1 + 2 Σ ρ_k, trials pooled; 1 for white noise."""
    pieces = [error[samples.trial == k] for k in range(len(samples.files))]
    pieces = [piece for piece in pieces if len(piece) > 1]
    if not pieces:
        return 1.0
    longest = max(len(piece) for piece in pieces)
    length, sums = next_fast_len(2 * longest, real=True), np.zeros(longest)
    for piece in pieces:
        spectrum = np.fft.rfft(piece, length)
        sums += np.fft.irfft(spectrum.real**2 + spectrum.imag**2, length)[:longest]
    if not 0.0 < sums[0] < np.inf:
        return 1.0
    correlation = sums / sums[0]
    below = np.flatnonzero(correlation < _DIED)
    end = int(below[0]) if len(below) else longest
    return float(max(1.0 + 2.0 * correlation[1:end].sum(), 1.0))
