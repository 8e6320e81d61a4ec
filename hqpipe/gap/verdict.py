"""What may be said: enough data, above the noise, predictable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.gap.bootstrap import block_weights
from hqpipe.gap.joint_scale import MIN_EXCITATION
from hqpipe.gap.reference import Explained
from hqpipe.gap.replay import Replay
from hqpipe.gap.tally import Tally

MIN_WINDOWS = 20  # assumption: with fewer windows an error has no usable uncertainty
SIGNIFICANCE = 0.05  # over all joints together (Bonferroni)
FLOOR_MARGIN = 1.05  # the floor itself is an estimate, good to a few per cent
UNPREDICTED_MARGIN = 2.0  # assumption: the floor takes noise for white; coloured noise is off by less
MIN_EXPLAINED = 0.05  # of the squared residual: less is no use to a simulator


@dataclass(frozen=True, eq=False)
class Evidence:
    """Per joint, (J,) each.

    Attributes:
        error: mean squared free-running error, held out, (N·m)².
        floor: what noise leaves of it; never more than what the reference model leaves, for noise cannot be
            predicted.
        explained: share of `error` that the reference model explains, held out.
        above: the error exceeds the floor for certain.
        predictable: the reference model explains part of it for certain.
    """

    error: np.ndarray
    floor: np.ndarray
    explained: np.ndarray
    above: np.ndarray
    predictable: np.ndarray

    @property
    def gap(self) -> np.ndarray:
        """(J,) True where the error exceeds the noise: predictably, or by too much for coloured noise."""
        return self.above & (self.predictable | (self.error > UNPREDICTED_MARGIN * self.floor))


def shortage(fit: list[Replay], heldout: list[Replay], sensor: np.ndarray) -> tuple[list[str], np.ndarray]:
    """What keeps the logs from being judged.

    Args:
        fit, heldout: replayed trials.
        sensor: (J,) variance of the torque sensor's noise, (N·m)².

    Returns:
        Reasons that stop the diagnosis, and (J,) True where a joint is excited enough to be judged.
    """
    reasons = []
    for name, replays in (("fit", fit), ("held-out", heldout)):
        windows = sum(r.windows for r in replays)
        if windows < MIN_WINDOWS:
            reasons.append(f"{windows} complete windows in the {name} trials, expected at least {MIN_WINDOWS}")
    if reasons:
        return reasons, np.zeros(len(sensor), dtype=bool)
    excited = np.zeros(len(sensor), dtype=bool)
    for item in heldout:
        moves = np.ptp(item.trajectory.position_command, axis=0) > 0
        excited |= moves & (item.trajectory.effort.std(axis=0) > MIN_EXCITATION * np.sqrt(sensor))
    if not excited.any():
        reasons.append("no joint is commanded to move and loaded above the noise of its torque sensor")
    return reasons, excited


def weigh(sums: Tally, floor: np.ndarray, explained: list[Explained], familiar: np.ndarray | float = 0.0) -> Evidence:
    """Compare error, floor and reference model with block-bootstrap bounds, joint by joint.

    Args:
        sums: held-out residuals by block.
        floor: (J,) from `hqpipe.gap.noise`.
        explained: one per joint, in order.
        familiar: (J,) what an earlier record of the machine may be off by without anything having changed.
    """
    square, count = sums.square[:, :, 0], sums.count[:, :, 0]
    error = square.sum(axis=0) / count.sum(axis=0)
    ratio = np.array([e.after.sum() / max(e.before.sum(), np.finfo(float).tiny) for e in explained])
    floor = np.maximum(np.minimum(floor, error * np.minimum(ratio, 1.0)), np.minimum(familiar, error))
    weights = block_weights(len(square))
    level = 100.0 * SIGNIFICANCE / len(error)
    low = np.percentile((weights @ square) / (weights @ count), level, axis=0)
    gain = np.array([_lower_gain(e, len(square), level) for e in explained])
    return Evidence(
        error=error,
        floor=floor,
        explained=1.0 - ratio,
        above=low > FLOOR_MARGIN * floor,
        predictable=(gain > 0.0) & (1.0 - ratio >= MIN_EXPLAINED),
    )


def _lower_gain(explained: Explained, blocks: int, level: float) -> float:
    """Lower bound of the squared residual that the reference model removes."""
    gain = explained.before - explained.after
    edges = np.linspace(0, len(gain), min(blocks, len(gain)), endpoint=False).astype(int)
    sums = np.add.reduceat(gain, edges)
    return float(np.percentile(block_weights(len(sums)) @ sums, level))
