"""Block bootstrap: intervals that respect the correlation of neighbouring samples.

Residuals at 1 kHz stay correlated over tenths of a second. Resampling whole blocks keeps that correlation
inside the blocks (Künsch, Annals of Statistics 17, 1989); resampling samples one by one would give intervals
several times too narrow.
"""

from __future__ import annotations

import numpy as np

BLOCK_S = 0.5  # assumption: several steps of a gait fit in one block less often than correlations die out
DRAWS = 1000
SEED = 0


def block_weights(blocks: int, draws: int = DRAWS, seed: int = SEED) -> np.ndarray:
    """(draws, blocks) how often each block occurs in a sample of `blocks` drawn with replacement."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=draws).astype(np.float64)


def interval(samples: np.ndarray, confidence: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper percentile over the first axis of `samples` (draws, …)."""
    tail = 50.0 * (1.0 - confidence)
    low, high = np.percentile(samples, [tail, 100.0 - tail], axis=0)
    return low, high
