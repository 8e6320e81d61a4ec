"""One joint of a log set as filtered samples, before anything is fitted to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import Bandwidth
from hqpipe.layers.joint_motion.columns import STRIBECK_SPEEDS, Columns, View, columns_of
from hqpipe.layers.joint_motion.coupling import Coupling, coupling_for
from hqpipe.layers.joint_motion.disturbances import bursts
from hqpipe.layers.joint_motion.first_fit import blocks, robust_fit, standard_errors
from hqpipe.layers.joint_motion.motion import ParallelFilter
from hqpipe.layers.joint_motion.output import Output
from hqpipe.layers.joint_motion.records import REST_SHARE, Filters, Part, Record, bridged, part_of, usable_samples
from hqpipe.logs.joint_kinds import PRISMATIC

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.joint_motion import MovingMachine

BASE = ("inertia", "offset", "gravity")
FRICTION = ("coulomb", "viscous")
UNDER_CUTOFF = 0.5  # cut-off of the common filter over that of the position: there the latter passes 99.6 %
LEAST_SAMPLES = 100  # filtered ones that move; assumption: ten times the parameters of base and friction
LEAST_MOVING_S = 1.0  # assumption: less holds no reversal of most machines
BLOCK_S = 0.5  # of correlated residuals; assumption: longer than a reversal
TOP = 0.99  # quantile of a torque that counts as its largest; assumption: a hundredth of the samples may be spikes
BEND = 0.02  # of the rms torque: less curvature is harmless to leave out; the accuracy of torque constants is no better


REVERSALS = "record motions with reversals at two speeds at least"
WHOLE = "record longer stretches in which no row is missing"
BELOW = "record motion that stays below the limit of the torque or current"
SIGNED = "log the torque with its sign"


class Unjudged(Exception):
    """Why a joint cannot be judged; `fix`: what to record instead."""

    def __init__(self, reason: str, fix: str) -> None:
        super().__init__(reason)
        self.fix = fix


@dataclass(frozen=True, eq=False)
class Prepared:
    """A joint whose samples are filtered.

    Attributes:
        j: its column. low_pass: the common filter. mean: of the position. records: per trial.
        parts: (fit, held-out).
    """

    j: int
    band: Bandwidth
    low_pass: ParallelFilter
    columns: Columns
    mean: float
    records: tuple[Record, ...]
    parts: tuple[Part, Part]

    def filtered(self, records: Sequence[Record], dt: float) -> tuple[Part, Part]:
        """Other records with the same filter."""
        own = (self.columns, Filters(self.band.cutoff, self.low_pass), dt, self.mean)
        return part_of(records, False, *own), part_of(records, True, *own)

    def group(self, *names: str) -> np.ndarray:
        """Indices of columns."""
        return np.array([k for name in names for k in self.columns[name]], dtype=np.int64)


def prepare(machine: MovingMachine, joint: str, output: Output) -> Prepared:
    """The filtered samples of one joint, with the columns that its motion and that of the other joints allow.

    Raises:
        Unjudged: it does not move enough, or its torque is constant.
    """
    logs = machine.log_set
    j = logs.joints.index(joint)
    fit = [k for k, trial in enumerate(logs.trials) if trial.split == "fit"]
    band = machine.bandwidths[j]
    if band is None:
        raise Unjudged("it does not move in the trials of the fit", REVERSALS)
    if not any(np.ptp(output.values[t]) > 0.0 for t in fit):
        raise Unjudged(
            "its torque is constant in the trials of the fit", "log a torque or current that follows the motion"
        )
    speeds = np.abs(np.concatenate([machine.motions[t][j].velocity for t in fit]))
    moving = speeds[~np.concatenate([machine.motions[t][j].rest for t in fit])]
    if len(moving) * machine.dt < LEAST_MOVING_S:
        raise Unjudged(f"it moves for {len(moving) * machine.dt:.1f} s only in the trials of the fit", REVERSALS)
    coupling, near = _coupling(machine, j, output.turns, len(moving) * machine.dt * band.cutoff)
    views, mean = _views(machine, j, near, fit)
    top = float(np.quantile(moving, 0.95))
    bends = output.kind is not None or bool(output.moment) or _gravity_bends(machine, output, fit, j)
    travel = max(float(np.std(np.concatenate([views[t].x for t in fit]))), np.finfo(float).tiny)
    columns = columns_of(
        output.turns,
        bends,
        coupling,
        travel,
        np.geomspace(0.02 * top, top, STRIBECK_SPEEDS),
    )
    margin = _margin(band, machine.dt)
    records = tuple(
        Record(
            trial.file,
            trial.split == "heldout",
            trial.trajectory.start,
            values,
            usable_samples(values, bridged(trial.trajectory.recorded[:, j], band.cutoff, machine.dt), margin),
            view,
        )
        for trial, values, view in zip(logs.trials, output.values, views, strict=True)
    )
    low_pass = ParallelFilter.of(UNDER_CUTOFF * band.cutoff, machine.dt)
    none = part_of((), False, columns, Filters(band.cutoff, low_pass), machine.dt, mean)
    found = Prepared(j, band, low_pass, columns, mean, records, (none, none))
    return replace(found, parts=found.filtered(records, machine.dt))


def _coupling(machine: MovingMachine, j: int, turns: bool, independent: float) -> tuple[Coupling | None, list[int]]:
    """Terms of the other joints, as many as the log can bear, and which joints those are.

    Args:
        turns: whether this one does. independent: samples, by time and bandwidth.
    """
    logs = machine.log_set
    moving = [k for k in range(len(logs.joints)) if k == j or machine.bandwidths[k] is not None]
    chain = [turns if k == j else logs.kinds.get(logs.joints[k]) != PRISMATIC for k in moving]
    coupling, first = coupling_for(chain, moving.index(j), independent)
    if coupling is None:
        return None, []
    taken = moving[first : first + len(coupling.turns)]
    return coupling, [k for k in taken if k != j]


def _views(machine: MovingMachine, j: int, near: Sequence[int], fit: Sequence[int]) -> tuple[list[View], float]:
    """Motion of the joint and of those near it in each trial, and the mean position that it counts from."""
    logs = machine.log_set
    means = {
        k: machine.posture.get(
            logs.joints[k], float(np.mean(np.concatenate([machine.motions[t][k].position for t in fit])))
        )
        for k in (j, *near)
    }
    turns = {k: logs.kinds.get(logs.joints[k]) != PRISMATIC for k in near}
    views = []
    for motions in machine.motions:
        others = tuple((motions[k].position - means[k], motions[k], turns[k]) for k in near)
        views.append(View(motions[j].position - means[j], motions[j], others))
    return views, means[j]


def _gravity_bends(machine: MovingMachine, output: Output, fit: Sequence[int], j: int) -> bool:
    """Whether the curvature of a gravity that the drive holds would show over the travel of a joint of unknown kind.

    Gravity G·sin(q + φ) bends by −G·sin(q + φ), which is at most the largest torque; over the travel that makes travel²/8
    of it.
    """
    position = np.concatenate([machine.motions[t][j].position for t in fit])
    torque = np.concatenate([output.values[t] for t in fit])
    top = float(np.quantile(np.abs(torque), TOP))
    return top * np.ptp(position) ** 2 / 8.0 > BEND * float(np.std(torque))


def check(data: Prepared, machine: MovingMachine, signless: bool) -> None:
    """Refuse a joint of which too little can be used.

    Args:
        signless: whether the torque was logged without its sign.

    Raises:
        Unjudged: too few samples of the fit trials are evidence.
    """
    fit, step = data.parts[0], data.low_pass.step * machine.dt
    if _enough(len(fit.keep), step):
        return
    moving = int(np.sum(fit.rest <= REST_SHARE))
    reason = f"it moves clearly, with a torque that can be used, for {len(fit.keep) * step:.1f} s only"
    total, unusable, lost = _counts(data, machine)
    if _enough(moving, step):
        other = SIGNED if signless else BELOW
        raise Unjudged(f"{reason} of {moving * step:.1f} s", WHOLE if lost > 0.5 * unusable else other)
    raise Unjudged(reason, WHOLE if lost > 0.5 * total else REVERSALS)


def _enough(samples: int, step: float) -> bool:
    return samples >= LEAST_SAMPLES and samples * step >= LEAST_MOVING_S


def _counts(data: Prepared, machine: MovingMachine) -> tuple[int, int, int]:
    """Samples of the fit trials: all, those that cannot be used, and those lost in gaps or near an end."""
    total = unusable = lost = 0
    margin = _margin(data.band, machine.dt)
    for trial, record in zip(machine.log_set.trials, data.records, strict=True):
        if not record.heldout:
            seen = bridged(trial.trajectory.recorded[:, data.j], data.band.cutoff, machine.dt)
            seen[:margin] = seen[len(seen) - margin :] = False
            total, unusable, lost = total + len(seen), unusable + np.sum(~record.usable), lost + np.sum(~seen)
    return total, int(unusable), int(lost)


def _margin(band: Bandwidth, dt: float) -> int:
    """Samples at each end of a trial that the filter of the position spoils."""
    return round(1.0 / (band.cutoff * dt))


def without_bursts(data: Prepared, dt: float, notes: list[str]) -> Prepared:
    """The joint without the samples at which something outside pushed; a note says for how long."""
    step = data.low_pass.step * dt
    masks = bursts(*data.parts, step)
    seconds = sum(int(mask.sum()) for mask in masks) * step
    if seconds:
        notes.append(
            f"{seconds:.1f} s in which the torque departs in bursts from every model are left out: something outside pushed, "
            "or hit"
        )
    return replace(data, parts=tuple(part.without(mask) for part, mask in zip(data.parts, masks, strict=True)))


def first_fit(data: Prepared, *names: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Robust coefficients of groups of columns, their standard errors, and the residual."""
    fit, picked = data.parts[0], data.group(*names)
    x, y = fit.columns[np.ix_(fit.keep, picked)], fit.output[fit.keep]
    found = robust_fit(x, y)
    residual = y - x @ found
    covariance = standard_errors(x, residual, blocks(fit.segment[fit.keep], fit.time[fit.keep], BLOCK_S))
    return found, np.sqrt(np.maximum(np.diag(covariance), 0.0)), residual
