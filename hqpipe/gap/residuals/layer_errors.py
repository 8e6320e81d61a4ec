"""The errors of a layer's joints on the trials that judge them: by block, joint and regime.

A layer predicts the samples of each joint that can be judged; they need not be the same ones in every joint. Blocks are
stretches of time of a trial, common to all joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hqpipe.gap.residuals.bootstrap import BLOCK_S
from hqpipe.gap.residuals.joint_scale import joint_scale
from hqpipe.gap.residuals.tally import ALL, Tally
from hqpipe.identify.found import Fitted, JointFound, LayerFound
from hqpipe.identify.model import Samples
from hqpipe.logs.trajectory import LogSet

STILL_SHARE = 0.02  # of the 99th percentile of |q̇|; assumption
FAST_PERCENTILE = 80.0  # assumption: enough samples stay on either side
REVERSAL_S = 0.02  # on each side of a change of direction; assumption
RAN_AWAY = (
    10.0  # spreads of the joint that a prediction without a number counts; assumption: worse than any that has one
)
_OVERFLOWS = 1e100  # spreads, from which on a prediction has run away: sums of squares would overflow; assumption
_SAMPLES = 20  # of a trial, to tell its noise from differences of up to the eighth order; assumption


@dataclass(frozen=True, eq=False)
class JudgedJoint:
    """One joint on its held-out samples; on the fit samples where none are held out (`heldout` False)."""

    found: JointFound
    heldout: bool

    @property
    def name(self) -> str:
        return self.found.model.joint

    @property
    def samples(self) -> Samples:
        return self.found.model.heldout if self.heldout else self.found.model.fit

    def error(self, fitted: Fitted) -> np.ndarray:
        """(N,) of a set of effects; a prediction that ran away counts `RAN_AWAY` spreads."""
        return self.bounded(fitted.heldout if self.heldout else fitted.error)

    def bounded(self, error: np.ndarray) -> np.ndarray:
        """(N,) an error of either split; a prediction that ran away counts `RAN_AWAY` spreads."""
        known = self._is_number(error)
        return error if known.all() else np.where(known, error, RAN_AWAY * self.scale)

    def _is_number(self, error: np.ndarray) -> np.ndarray:
        """(N,) bool"""
        return np.abs(error) < _OVERFLOWS * self.scale

    @property
    def ran_away(self) -> float:
        """Share of the samples at which the prediction without or with the causes is no number."""
        parts = [f.heldout if self.heldout else f.error for f in (self.found.base, self.found.named)]
        return float(np.mean(~(self._is_number(parts[0]) & self._is_number(parts[1]))))

    def mean_square(self, fitted: Fitted) -> float:
        return float(np.mean(self.error(fitted) ** 2))

    @property
    def noise(self) -> float:
        """Mean square that sensor noise leaves."""
        return self.found.model.noise[1 if self.heldout else 0] ** 2

    @cached_property
    def scale(self) -> float:
        """See `hqpipe.gap.residuals.joint_scale`."""
        fit = self.found.model.fit
        parts = [fit.output[fit.trial == i] for i in np.unique(fit.trial)]
        return joint_scale([part for part in parts if len(part) >= _SAMPLES] or [fit.output])


@dataclass(frozen=True, eq=False)
class LayerErrors:
    """All joints of a layer.

    Attributes:
        joints: in the order of the layer. files: of the judged trials, in the order of the logs.
        whole: file → (s from the start of the recording to the first sample, length of the recording).
        block_s: length of a block. material: share of the output's spread, below which a gap does not matter.
    """

    joints: tuple[JudgedJoint, ...]
    files: tuple[str, ...]
    whole: dict[str, tuple[float, float]]
    block_s: float
    material: float

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def units(self) -> list[str]:
        return [joint.found.model.unit for joint in self.joints]

    @cached_property
    def scale(self) -> np.ndarray:
        """(J,)"""
        return np.array([joint.scale for joint in self.joints])

    @cached_property
    def blocks(self) -> list[np.ndarray]:
        """Per joint (N,) number of the block of each sample, numbered through all trials."""
        return self._blocks[0]

    @cached_property
    def trial_of_block(self) -> np.ndarray:
        """(B,) index into `files`."""
        return self._blocks[1]

    @cached_property
    def _blocks(self) -> tuple[list[np.ndarray], np.ndarray]:
        keys = []
        for joint in self.joints:
            s = joint.samples
            trial = np.array([self.files.index(file) for file in s.files], dtype=np.int64)[s.trial]
            keys.append(np.column_stack([trial, np.floor(s.time / self.block_s + 1e-9).astype(np.int64)]))
        known, index = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
        ends = np.cumsum([len(key) for key in keys])[:-1]
        return np.split(index.reshape(-1), ends), known[:, 0]

    def sums(self, squares: Sequence[np.ndarray]) -> np.ndarray:
        """(B, J) sums over the samples of each block; squares: per joint (N,)."""
        count = len(self.trial_of_block)
        return np.column_stack(
            [np.bincount(block, square, count) for block, square in zip(self.blocks, squares, strict=True)]
        )

    @cached_property
    def counts(self) -> np.ndarray:
        """(B, J) samples."""
        return self.sums([np.ones(len(joint.samples.time)) for joint in self.joints])

    def relative(self, j: int, fitted: Fitted) -> np.ndarray:
        """(B,) what one joint adds to the squared pooled error of the layer."""
        square = np.bincount(self.blocks[j], self.joints[j].error(fitted) ** 2, len(self.trial_of_block))
        return square / (self.counts[:, j].sum() * self.scale[j] ** 2 * len(self.joints))

    def tally(self, fitted: Sequence[Fitted]) -> Tally:
        """Squared errors by block, joint and regime; fitted: per joint."""
        labels = [_labels(joint.samples, self.whole) for joint in self.joints]
        regimes = ((ALL, ALL), *labels[0])
        inside = [
            [np.ones(len(joint.samples.time)), *own.values()] for joint, own in zip(self.joints, labels, strict=True)
        ]
        squares = [joint.error(f) ** 2 for joint, f in zip(self.joints, fitted, strict=True)]
        square = np.stack(
            [self.sums([s * i[r] for s, i in zip(squares, inside, strict=True)]) for r in range(len(regimes))], 2
        )
        count = np.stack([self.sums([i[r] for i in inside]) for r in range(len(regimes))], 2)
        return Tally(regimes, square, count, self.trial_of_block)


def layer_errors(found: LayerFound, log_set: LogSet) -> LayerErrors:
    """Errors of the joints of a layer; log_set: that it was asked of."""
    joints = tuple(JudgedJoint(f, len(f.model.heldout.time) > 0) for f in found.found)
    there = {joint.samples.files[i] for joint in joints for i in np.unique(joint.samples.trial)}
    whole = {trial.file: (trial.trajectory.start, trial.trajectory.whole) for trial in log_set.trials}
    named = {file for joint in joints for file in joint.samples.files}
    files = [*(file for file in whole if file in named), *sorted(named - whole.keys())]
    files = [file for file in files if file in there] + [file for file in files if file not in there]
    return LayerErrors(joints, tuple(files), whole, max(BLOCK_S, found.joints.window_s), found.joints.material)


def _labels(s: Samples, whole: dict[str, tuple[float, float]]) -> dict[tuple[str, str], np.ndarray]:
    """(family, regime) → (N,) bool: direction, reversal, speed, quarter of the trial."""
    speed = np.abs(s.velocity)
    still = speed <= STILL_SHARE * np.percentile(speed, 99.0)
    fast = speed > np.percentile(speed, FAST_PERCENTILE)
    near = _reversals(s, still)
    quarter = np.zeros(len(s.time), dtype=np.int64)
    for i in np.unique(s.trial):
        rows = s.trial == i
        start, length = whole.get(s.files[i], (0.0, float(s.time[rows].max())))
        quarter[rows] = np.minimum(4.0 * (start + s.time[rows]) / max(length, 1e-300), 3.0).astype(np.int64)
    return {
        ("direction", "extending"): ~still & (s.velocity > 0),
        ("direction", "retracting"): ~still & (s.velocity < 0),
        ("direction", "standstill"): still,
        ("reversal", "reversal"): near,
        ("reversal", "between_reversals"): ~near,
        ("speed", "high_speed"): fast,
        ("speed", "low_speed"): ~fast,
        **{("time_span", f"quarter_{k + 1}"): quarter == k for k in range(4)},
    }


def _reversals(s: Samples, still: np.ndarray) -> np.ndarray:
    """(N,) within 20 ms of a change of the sign of the velocity, or half a sample where samples are further apart."""
    near = np.zeros(len(s.time), dtype=bool)
    for i in np.unique(s.trial):
        rows = np.flatnonzero(s.trial == i)
        moving = rows[~still[rows]]
        sign = np.sign(s.velocity[moving])
        turn = np.flatnonzero(sign[1:] != sign[:-1])
        if not len(turn):
            continue
        events = 0.5 * (s.time[moving[turn]] + s.time[moving[turn + 1]])
        reach = max(REVERSAL_S, 0.5 * float(np.median(np.diff(s.time[rows]))) * (1.0 + 1e-9))
        after = np.searchsorted(events, s.time[rows])
        behind = s.time[rows] - events[np.maximum(after - 1, 0)]
        ahead = events[np.minimum(after, len(events) - 1)] - s.time[rows]
        near[rows] = np.minimum(np.abs(behind), np.abs(ahead)) <= reach
    return near
