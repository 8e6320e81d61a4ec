"""How large the torque is in each direction of motion, then and now: what can be compared where no model predicts it.

A model that errs as much as holding the last torque says nothing about a change. The mean size of the torque at the same motion
still does: friction that grows raises it in both directions, a load in one and not in the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.trajectory import LogSet

BLIND = 0.9  # of the squared error of holding the torque: a model that leaves more explains next to nothing; assumption
MOVING = 0.2  # of the RMS speed: slower is rest
LEAST_TRIALS = 4  # on each side, for a spread between trials; assumption
LEAST = 0.05  # share by which levels must differ: less is drift of temperature and supply; assumption
SURE = 1e-3  # probability of such a difference by chance, over all that is compared
DIRECTIONS = ("forward", "backward")

Levels = Mapping[str, np.ndarray]
"""Joint → (trials, 2, 2): mean size of torque and of speed, forward and backward; NaN without such motion."""


@dataclass(frozen=True)
class Changed:
    """A level that differs: mean size of the torque then and now, N·m (N)."""

    joint: str
    direction: str
    then: float
    now: float


def levels_of(log_set: LogSet) -> dict[str, np.ndarray]:
    """Levels of every joint; empty without torque."""
    if log_set.trials[0].trajectory.effort is None:
        return {}
    found = {}
    for j, joint in enumerate(log_set.joints):
        speed = [trial.trajectory.velocity[:, j] for trial in log_set.trials]
        slow = MOVING * float(np.sqrt(np.mean(np.concatenate(speed) ** 2)))
        effort = [trial.trajectory.effort[:, j] for trial in log_set.trials]
        found[joint] = np.array([_levels(e, v, slow) for e, v in zip(effort, speed, strict=True)])
    return found


def _levels(effort: np.ndarray, speed: np.ndarray, slow: float) -> list[list[float]]:
    sides = (speed > slow, speed < -slow)
    return [[float(np.mean(np.abs(x[side]))) if side.any() else np.nan for side in sides] for x in (effort, speed)]


def compare(then: Levels, now: Levels, joints: Sequence[str]) -> tuple[list[Changed], list[str]]:
    """What differs, and the joints that cannot be compared: too few trials, or another motion.

    Args:
        then, now: see `levels_of`. joints: to compare.
    """
    from scipy.stats import ttest_ind

    sure = SURE / max(1, 2 * len(joints))
    changed, apart = [], []
    for joint in joints:
        if joint not in then or joint not in now:
            apart.append(joint)
            continue
        for side, direction in enumerate(DIRECTIONS):
            pairs = [[x[np.isfinite(x)] for x in (old[joint][:, kind, side] for old in (then, now))] for kind in (0, 1)]
            if min(len(x) for pair in pairs for x in pair) < LEAST_TRIALS:
                apart.append(joint)
                break
            differs = []
            for before, after in pairs:
                share = abs(after.mean() / before.mean() - 1.0)
                differs.append(share > LEAST and ttest_ind(before, after, equal_var=False).pvalue < sure)
            if differs[1]:
                apart.append(joint)
                break
            if differs[0]:
                changed.append(Changed(joint, direction, float(pairs[0][0].mean()), float(pairs[0][1].mean())))
    return changed, apart
