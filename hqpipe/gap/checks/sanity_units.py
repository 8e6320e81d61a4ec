"""Trials whose positions are in another unit than those of the others."""

from __future__ import annotations

import numpy as np

from hqpipe.gap.checks.defect import Defect
from hqpipe.logs.trajectory import LogSet

FACTORS = {180.0 / np.pi: "degrees where the others are in radians", 1000.0: "mm where the others are in m"}
MIN_TRIALS = 3  # of two trials none is the odd one


def unit_defects(log_set: LogSet) -> list[Defect]:
    """Trials in which most joints move more than those of the others by about the ratio of two units.

    A livelier trial looks alike: whether the factor is one of units, the comparison of models says.
    """
    if len(log_set.trials) < MIN_TRIALS:
        return []
    size = np.array([trial.trajectory.position.std(axis=0) for trial in log_set.trials])  # (trials, J)
    usual = np.median(size, axis=0)
    found = []
    for trial, mine in zip(log_set.trials, size, strict=True):
        ratio = float(np.median(mine[usual > 0] / usual[usual > 0])) if (usual > 0).any() else 0.0
        factor = min(FACTORS, key=lambda f: abs(np.log(f / max(ratio, 1e-300))))
        if ratio < np.sqrt(factor):  # nearer to no factor at all
            continue
        text = (
            f"the positions in {trial.file} are {ratio:.3g} times as large as in the other trials: they look like "
            f"{FACTORS[factor]}; convert them"
        )
        found.append(Defect("other_units", (trial.file,), (), None, text, fatal=True, factor=factor))
    return found
