"""What may be said of a layer: whether there is a gap, and whether the causes explain it.

No real machine is in the span of a library of effects, so that even the right causes leave an error above the noise of the
sensors. A gap counts as explained where the causes close most of it: of the joints relative to their spread, in which each
counts alike, and in their common unit, which is what a reader is told first; and where no joint keeps most of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.gap.residuals.bootstrap import block_weights
from hqpipe.gap.residuals.layer_errors import LayerErrors
from hqpipe.identify.found import Fitted
from hqpipe.identify.thresholds import LEAST_GAIN

EXPLAINED = 0.25  # of the squared gap may be left: the causes halve the gap at least; assumption
MOST = 0.5  # of the squared gap of a joint: with more left it is not explained, whatever the others are
SIGNIFICANCE = 0.05  # over all joints together (Bonferroni)
FLOOR_MARGIN = 1.05  # the floor itself is an estimate, good to a few per cent
UNPREDICTED_MARGIN = 2.0  # assumption: the floor takes noise for white; coloured noise is off by less
RARE_MARGIN = 4.0
"""Over the floor, from which a mean squared error is none of noise, in however few blocks it lies; assumption: twice what
coloured noise may be. Without it a limit that is reached twice in a trial is no gap, as the blocks by chance may miss it."""


@dataclass(frozen=True, eq=False)
class LayerEvidence:
    """Mean squared errors of the joints, (J,) each, in the squared unit of each.

    Attributes:
        before, after: without effects and with the causes. flexible: with the generic shapes besides; never more than `after`.
        noise: what sensor noise leaves; never more than `flexible`. floor: what is no gap: the noise, or what an earlier record
            missed when it was made.
        persistence: of holding the output. scale: of the joints. one_unit: whether all joints have the same unit.
        gap, rest: (J,) True where the error before and after the causes is above the floor and matters.
        predictable: (J,) True where the flexible model explains part of what is left for certain.
    """

    before: np.ndarray
    after: np.ndarray
    flexible: np.ndarray
    noise: np.ndarray
    floor: np.ndarray
    persistence: np.ndarray
    scale: np.ndarray
    one_unit: bool
    gap: np.ndarray
    rest: np.ndarray
    predictable: np.ndarray

    @property
    def left(self) -> float:
        """Share of the squared gap above the floor that is left, relative to the spread of each joint."""
        return self._left(self.scale)

    @property
    def blind(self) -> bool:
        """Whether what is left is as large as the error of holding the output."""
        after, held = ((error / self.scale**2)[self.gap].sum() for error in (self.after, self.persistence))
        return bool(self.gap.any() and after >= held)

    def verdict(self, causes: bool) -> str:
        if not causes:
            return "unknown" if self.gap.any() else "no_gap"
        if self.blind:
            return "partly_explained"
        left = max(self.left, self._left(np.ones_like(self.scale))) if self.one_unit else self.left
        closed = left <= EXPLAINED and not self._keeps_most().any()
        return "explained" if closed or not self.rest.any() else "partly_explained"

    def _left(self, scale: np.ndarray) -> float:
        return _ratio(float(self._above(self.after, scale).sum()), float(self._above(self.before, scale).sum()))

    def _keeps_most(self) -> np.ndarray:
        """(joints with a gap,) True where more is left than half of the joint's squared gap, and of the mean one of all."""
        before = self._above(self.before, self.scale)
        mean = before.sum() / max(before.size, 1)
        return self._above(self.after, self.scale) > MOST * np.maximum(before, mean)

    def _above(self, error: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """(joints with a gap,) what of a squared error is above the floor, over the square of a scale."""
        return (np.maximum(error - self.floor, 0.0) / scale**2)[self.gap]


def _ratio(part: float, whole: float) -> float:
    return min(part / whole, 1.0) if whole > 0.0 else 0.0


def weigh_layer(errors: LayerErrors, familiar: np.ndarray | float = 0.0) -> LayerEvidence:
    """Compare the errors of a layer with its floor and with what could be predicted.

    Args:
        familiar: (J,) mean squared error of an earlier record on its own logs, which is no change.
    """
    joints = errors.joints
    before, after, full = (
        np.array([joint.mean_square(getattr(joint.found, name)) for joint in joints])
        for name in ("base", "named", "full")
    )
    flexible = np.minimum(full, after)
    noise = np.minimum([joint.noise for joint in joints], flexible)  # what a model predicts was no noise
    floor = np.maximum(noise, np.minimum(familiar, before))
    held = [np.mean((joint.samples.output - joint.samples.held) ** 2) for joint in joints]
    weights = block_weights(len(errors.trial_of_block))
    gap, _ = _above(errors, [joint.found.base for joint in joints], before, flexible, floor, weights)
    rest, predictable = _above(errors, [joint.found.named for joint in joints], after, flexible, floor, weights)
    one_unit = len(set(errors.units)) == 1
    return LayerEvidence(
        before, after, flexible, noise, floor, np.array(held), errors.scale, one_unit, gap, rest, predictable
    )


def _above(
    errors: LayerErrors,
    fitted: list[Fitted],
    error: np.ndarray,
    flexible: np.ndarray,
    floor: np.ndarray,
    weights: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(J,) where an error is above the floor for certain and matters, and where it is predictable for certain."""
    joints, level = errors.joints, 100.0 * SIGNIFICANCE / len(errors.joints)
    squares = [joint.error(f) ** 2 for joint, f in zip(joints, fitted, strict=True)]
    gains = [square - joint.error(joint.found.full) ** 2 for joint, square in zip(joints, squares, strict=True)]
    count = np.maximum(weights @ errors.counts, 1e-300)
    low, gain = (np.percentile((weights @ errors.sums(x)) / count, level, axis=0) for x in (squares, gains))
    predictable = (gain > 0.0) & (error - flexible >= LEAST_GAIN * error)
    clear = (low > FLOOR_MARGIN * floor) & (predictable | (error > UNPREDICTED_MARGIN * floor))
    clear |= error > RARE_MARGIN * floor
    return clear & (error - floor > (errors.material * errors.scale) ** 2), predictable
