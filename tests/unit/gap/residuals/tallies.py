"""Sums of squared errors by hand: noise everywhere, and an error of one joint in one regime beside it."""

from __future__ import annotations

import numpy as np

from hqpipe.gap.residuals.tally import ALL, Tally

BLOCKS, SAMPLES = 40, 500  # of one trial; samples of each joint in a block
NOISE = 4.0  # mean square
JOINTS = ("LFR", "LFP", "LFK")
SHARES = {
    (ALL, ALL): 1.0,
    ("speed", "high_speed"): 0.1,
    ("speed", "low_speed"): 0.9,
    ("direction", "extending"): 0.5,
    ("direction", "retracting"): 0.5,
    **{("time_span", f"quarter_{k + 1}"): 0.25 for k in range(4)},
}
"""Regime → its share of the samples."""


def tally(joint: int = 0, regime: tuple[str, str] = (ALL, ALL), size: float = 0.0, seed: int = 0) -> Tally:
    """An error with a mean square of `size` in a regime of a joint, which cares about no regime of another family."""
    rng, regimes = np.random.default_rng(seed), tuple(SHARES)
    inside = np.tile(list(SHARES.values()), (BLOCKS, 1))
    quarter = np.arange(BLOCKS) * 4 // BLOCKS
    for r, (family, name) in enumerate(regimes):
        if family == "time_span":
            inside[:, r] = quarter + 1 == int(name[-1])
    count = SAMPLES * np.repeat(inside[:, None, :], len(JOINTS), axis=1)
    square = NOISE * count * rng.gamma(50.0, 1.0 / 50.0, (BLOCKS, len(JOINTS), 1))
    own = regimes.index(regime)
    error = size * SAMPLES * inside[:, own] * rng.gamma(5.0, 1.0 / 5.0, BLOCKS)
    for r, (family, _) in enumerate(regimes):
        square[:, joint, r] += error * (float(r == own) if family == regime[0] else inside[:, r])
    return Tally(regimes, square, count, np.zeros(BLOCKS, dtype=np.int64))
