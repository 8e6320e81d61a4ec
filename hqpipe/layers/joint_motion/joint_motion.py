"""What lies between the logged torque of a joint and its motion, without a URDF."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.identify.model import LayerJoints
from hqpipe.layers.joint_motion.bandwidth import Bandwidth, bandwidth
from hqpipe.layers.joint_motion.judged import judge
from hqpipe.layers.joint_motion.motion import Motion, motion_of, resolution, rest_speed
from hqpipe.layers.joint_motion.output import has_output
from hqpipe.layers.joint_motion.prepared import Unjudged
from hqpipe.layers.refusal import no_joint_judged
from hqpipe.logs.findings import listed
from hqpipe.logs.trajectory import LogSet

LEAST_TRIAL = 64  # samples: shorter trials have no filtered sample


@dataclass(frozen=True, eq=False)
class MovingMachine:
    """The filtered motion of all joints.

    Attributes:
        log_set: with trials long enough to filter. dt: s. bandwidths: of each joint, None for one that does not move.
        motions: per trial, of each joint. posture: joint → position from which angles count; its mean where none is given.
    """

    log_set: LogSet
    dt: float
    bandwidths: tuple[Bandwidth | None, ...]
    motions: tuple[tuple[Motion | None, ...], ...]
    posture: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class JointMotion:
    """Torque or motor current against motion: one inertia, a constant and gravity per joint, and what is missing in that."""

    posture: Mapping[str, float] = field(default_factory=dict)
    NAME: ClassVar[str] = "joint_motion"

    def comparing(self, log_set: LogSet, earlier: LogSet) -> JointMotion:
        """The layer for two records of one machine, whose angles count from one posture."""
        shared = [joint for joint in log_set.joints if joint in earlier.joints]
        return JointMotion({joint: _mean(log_set, earlier, joint) for joint in shared})

    def lacking(self, log_set: LogSet) -> list[str]:
        """A torque or a current; positions are in every log."""
        return [] if has_output(log_set) else ["joint/<name>/effort or joint/<name>/current"]

    def joints(self, log_set: LogSet, window_s: float | None = None, without: Collection[str] = ()) -> LayerJoints:
        """A model of each joint that moves enough.

        Args:
            log_set: any. window_s: s, over which persistence is asked; None: the length of the filter, 0.1 s at least.
            without: effects that are left out of the library.

        Raises:
            IdentificationError: no joint can be judged.
        """
        if lacking := self.lacking(log_set):
            raise IdentificationError(
                f"{log_set.path}: the layer {self.NAME} needs {' and '.join(lacking)}",
                file=log_set.path,
                fix="record the torque or the motor current of each joint",
            )
        machine = replace(moving_machine(log_set), posture=self.posture)
        models, left, fixes, warnings = [], {}, {}, []
        for joint in log_set.joints:
            try:
                models.append(judge(machine, joint, window_s, without))
            except Unjudged as reason:
                left[joint] = str(reason)
                fixes.setdefault(reason.fix, []).append(joint)
        if not models:
            raise no_joint_judged(log_set.path, "from torque and motion", left, _fix(fixes))
        if any(model.unsigned for model in models):
            names = ", ".join(model.joint for model in models if model.unsigned)
            warnings.append(f"the torque of {names} was logged without its sign, which was restored from the motion")
        length = max(model.back * model.dt for model in models)
        chosen = "as asked" if window_s else "the length of the filter on torque and motion, about 0.1 s at least"
        return LayerJoints(
            layer=self.NAME,
            metric="inverse_dynamics_rmse",
            window_s=float(window_s or length),
            window_reason=chosen,
            models=tuple(models),
            left=left,
            warnings=tuple(warnings),
        )


def _fix(fixes: Mapping[str, Sequence[str]]) -> str:
    """What to record. fixes: that → joints that ask for it."""
    if len(fixes) == 1:
        return next(iter(fixes))
    return "; ".join(f"{listed(joints)}: {fix}" for fix, joints in fixes.items())


def _mean(one: LogSet, other: LogSet, joint: str) -> float:
    """Position of a joint, mean over the fit trials of two records."""
    positions = [t.trajectory.position[:, logs.joints.index(joint)] for logs in (one, other) for t in logs.fit]
    return float(np.mean(np.concatenate(positions)))


def moving_machine(log_set: LogSet) -> MovingMachine:
    """Filtered motion of all joints in all trials.

    Raises:
        IdentificationError: no fit trial is long enough.
    """
    trials = tuple(t for t in log_set.trials if t.trajectory.samples >= LEAST_TRIAL)
    if not any(t.split == "fit" for t in trials):
        raise IdentificationError(
            f"{log_set.path}: no trial of the fit has {LEAST_TRIAL} samples",
            file=log_set.path,
            fix="record longer trials",
        )
    log_set = replace(log_set, trials=trials)
    dt = float(np.median([t.trajectory.dt for t in trials]))
    found: list[Bandwidth | None] = []
    columns: list[list[Motion | None]] = []
    for j in range(len(log_set.joints)):
        fit = [t.trajectory.position[:, j] for t in log_set.fit]
        if max(np.ptp(q) for q in fit) == 0.0:
            found.append(None)
            columns.append([None] * len(trials))
            continue
        band = bandwidth(fit, dt)
        slow = rest_speed(band, dt, min((r for r in map(resolution, fit) if r > 0.0), default=0.0))
        found.append(band)
        columns.append([motion_of(t.trajectory.position[:, j], dt, band.cutoff, slow) for t in trials])
    return MovingMachine(log_set, dt, tuple(found), tuple(zip(*columns, strict=True)))
