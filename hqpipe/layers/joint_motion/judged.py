"""From the motion of a machine and the torque of one joint to its model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import Bandwidth, noise_density, passed_noise
from hqpipe.layers.joint_motion.candidates import Scale, base_parameters, effects_of
from hqpipe.layers.joint_motion.columns import STRIBECK_SPEEDS, Columns, View, columns_of
from hqpipe.layers.joint_motion.coupling import REACH, SAMPLES_PER_TERM, Coupling, Nuisance, ridge_of
from hqpipe.layers.joint_motion.distinct import both_ways, distinguished
from hqpipe.layers.joint_motion.disturbances import bursts
from hqpipe.layers.joint_motion.first_fit import blocks, least_squares, robust_fit, standard_errors
from hqpipe.layers.joint_motion.instruments import endogeneity, projected, simulated
from hqpipe.layers.joint_motion.model import MotionModel
from hqpipe.layers.joint_motion.motion import ParallelFilter, motion_of
from hqpipe.layers.joint_motion.output import AMPERE, Output, output_of
from hqpipe.layers.joint_motion.records import Filters, Part, Record, part_of, usable_samples
from hqpipe.layers.joint_motion.sign_of_torque import Signs, lost_signs, never_negative
from hqpipe.logs.joint_kinds import PRISMATIC

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.joint_motion import MovingMachine

BASE = ("inertia", "offset", "gravity")
FRICTION = ("coulomb", "viscous")
UNDER_CUTOFF = 0.5  # cut-off of the common filter over that of the position: there the latter passes 99.6 %
LEAST_SAMPLES = 100  # filtered ones that move; assumption: ten times the parameters of base and friction
LEAST_MOVING_S = 1.0
DOUBTFUL = (
    1e-3  # share of noise in a regressor below which it biases nothing: stiff loops raise its effect ten-fold or so
)
SWEEP = (0.6, 1.7)  # of the cut-off, between which the answer should be stable
STABLE = 0.05  # change over the sweep that is worth a note, as a share of the coefficient and of the rms torque
CHANGED = 3.0  # standard errors
BLOCK_S = 0.5  # of correlated residuals; assumption: longer than a reversal
CLEAR = 5.0  # standard errors of the gravity that fixes a scale: 20 % would be no scale
TOP = 0.99  # quantile of a torque that counts as its largest
BEND = 0.02  # of the rms torque: less curvature is harmless to leave out; the accuracy of torque constants is no better
LEAST_WINDOW_S = 0.1  # over which persistence is asked, that of the other layers


class Unjudged(Exception):
    """Why a joint cannot be judged."""


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


def judge(machine: MovingMachine, joint: str, window_s: float | None, without: Collection[str]) -> MotionModel:
    """The model of one joint.

    Raises:
        Unjudged: it does not move enough.
    """
    output = output_of(machine.log_set, joint)
    joint_data = _prepare(machine, joint, output)
    notes = list(output.notes)
    signs = _signs(machine, joint_data, output)
    if signs:
        records = tuple(signs.restored(record, joint_data.columns) for record in joint_data.records)
        joint_data = replace(joint_data, records=records, parts=joint_data.filtered(records, machine.dt))
        notes.append(
            "only the size of the torque was logged; its sign is the one with which inertia, gravity and friction explain it "
            f"best ({100.0 * signs.share:.0f} % of it negative), and samples in which the sign is in doubt are left out"
        )
    _check(joint_data, machine.dt)
    joint_data = _without_bursts(joint_data, machine.dt, notes)
    output, joint_data = _in_newton_metres(output, joint_data, notes)
    projection = _instruments(machine, joint_data, notes)
    _sweep(machine, joint_data, notes)
    return _model(machine, joint, output, joint_data, projection, bool(signs), notes, window_s, without)


def _prepare(machine: MovingMachine, joint: str, output: Output) -> Prepared:
    logs = machine.log_set
    j = logs.joints.index(joint)
    fit = [k for k, trial in enumerate(logs.trials) if trial.split == "fit"]
    band = machine.bandwidths[j]
    if band is None:
        raise Unjudged("it does not move in the trials of the fit")
    if not any(np.ptp(output.values[t]) > 0.0 for t in fit):
        raise Unjudged("its torque is constant in the trials of the fit")
    near = [k for k in range(j - REACH, j + REACH + 1) if k != j and 0 <= k < len(logs.joints)]
    near = [k for k in near if machine.bandwidths[k] is not None]
    turns = [logs.kinds.get(logs.joints[k]) != PRISMATIC for k in near]
    means = {k: float(np.mean(np.concatenate([machine.motions[t][k].position for t in fit]))) for k in (j, *near)}
    views = []
    for motions in machine.motions:
        others = tuple((motions[k].position - means[k], motions[k], turn) for k, turn in zip(near, turns, strict=True))
        views.append(View(motions[j].position - means[j], motions[j], others))
    speeds = np.abs(np.concatenate([machine.motions[t][j].velocity for t in fit]))
    moving = speeds[~np.concatenate([machine.motions[t][j].rest for t in fit])]
    if len(moving) * machine.dt < LEAST_MOVING_S:
        raise Unjudged(f"it moves for {len(moving) * machine.dt:.1f} s only in the trials of the fit")
    top = float(np.quantile(moving, 0.95))
    bends = output.kind is not None or bool(output.moment) or _gravity_bends(machine, output, fit, j)
    travel = max(float(np.std(np.concatenate([views[t].x for t in fit]))), np.finfo(float).tiny)
    columns = columns_of(
        output.turns,
        bends,
        _coupling(turns, sum(k < j for k in near), output.turns, len(moving) * machine.dt * band.cutoff),
        travel,
        np.geomspace(0.02 * top, top, STRIBECK_SPEEDS),
    )
    margin = round(1.0 / (band.cutoff * machine.dt))
    records = tuple(
        Record(
            trial.file,
            trial.split == "heldout",
            trial.trajectory.start,
            values,
            usable_samples(values, trial.trajectory.recorded[:, j], margin),
            view,
        )
        for trial, values, view in zip(logs.trials, output.values, views, strict=True)
    )
    low_pass = ParallelFilter.of(UNDER_CUTOFF * band.cutoff, machine.dt)
    none = part_of((), False, columns, Filters(band.cutoff, low_pass), machine.dt, means[j])
    found = Prepared(j, band, low_pass, columns, means[j], records, (none, none))
    return replace(found, parts=found.filtered(records, machine.dt))


def _coupling(others: Sequence[bool], before: int, turns: bool, independent: float) -> Coupling | None:
    """Terms of the other joints, as many as the log can bear.

    Args:
        others: whether each turns. before: how many of them come before this one. independent: samples, in time and bandwidth.
    """
    if not others:
        return None
    chain = (*others[:before], turns, *others[before:])
    second = Coupling(chain, before, True)
    return second if second.count() * SAMPLES_PER_TERM <= independent else Coupling(chain, before)


def _gravity_bends(machine: MovingMachine, output: Output, fit: Sequence[int], j: int) -> bool:
    """Whether the curvature of a gravity that the drive holds would show over the travel of a joint of unknown kind.

    Gravity G·sin(q + φ) bends by −G·sin(q + φ), which is at most the largest torque; over the travel that makes travel²/8
    of it.
    """
    position = np.concatenate([machine.motions[t][j].position for t in fit])
    torque = np.concatenate([output.values[t] for t in fit])
    top = float(np.quantile(np.abs(torque), TOP))
    return top * np.ptp(position) ** 2 / 8.0 > BEND * float(np.std(torque))


def _signs(machine: MovingMachine, data: Prepared, output: Output) -> Signs | None:
    """How to restore the sign of the torque, if it was lost."""
    if not never_negative(output.values):
        return None
    fit = [k for k, record in enumerate(data.records) if not record.heldout]
    pulls = None
    if machine.log_set.control_mode == "position":
        trials = [machine.log_set.trials[k].trajectory for k in fit]
        pulls = [(t.position_command - t.position)[:, data.j] for t in trials]
    return lost_signs([data.records[k] for k in fit], data.columns, pulls)


def _check(data: Prepared, dt: float) -> None:
    fit = data.parts[0]
    if len(fit.keep) < LEAST_SAMPLES or len(fit.keep) * data.low_pass.step * dt < LEAST_MOVING_S:
        seconds = len(fit.keep) * data.low_pass.step * dt
        raise Unjudged(f"it moves clearly, with a torque that can be used, for {seconds:.1f} s only")


def _without_bursts(data: Prepared, dt: float, notes: list[str]) -> Prepared:
    step = data.low_pass.step * dt
    masks = bursts(*data.parts, step)
    seconds = sum(int(mask.sum()) for mask in masks) * step
    if seconds:
        notes.append(
            f"{seconds:.1f} s in which the torque departs in bursts from every model are left out: something outside pushed, "
            "or hit"
        )
    return replace(data, parts=tuple(part.without(mask) for part, mask in zip(data.parts, masks, strict=True)))


def _first(data: Prepared, *names: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Robust coefficients of groups of columns, their standard errors, and the residual."""
    fit, picked = data.parts[0], data.group(*names)
    x, y = fit.columns[np.ix_(fit.keep, picked)], fit.output[fit.keep]
    found = robust_fit(x, y)
    residual = y - x @ found
    covariance = standard_errors(x, residual, blocks(fit.segment[fit.keep], fit.time[fit.keep], BLOCK_S))
    return found, np.sqrt(np.maximum(np.diag(covariance), 0.0)), residual


def _in_newton_metres(output: Output, data: Prepared, notes: list[str]) -> tuple[Output, Prepared]:
    """A current as torque, where a known load gives its scale."""
    if output.unit != AMPERE or not output.moment:
        return output, data
    found, errors, _ = _first(data, "inertia", "offset", "gravity", "coulomb", "viscous")
    amplitude = float(np.hypot(*found[2:4]))
    if amplitude < CLEAR * float(np.hypot(*errors[2:4])):
        notes.append("the stated load shows too little in the current to give its scale in N·m")
        return output, data
    factor = output.moment / amplitude
    notes[:] = [note for note in notes if note not in output.notes]
    scaled = output.scaled(factor, f"the gravity of the stated load makes 1 A of current {factor:.4g} N·m")
    notes += scaled.notes
    parts = tuple(replace(part, output=factor * part.output) for part in data.parts)
    records = tuple(replace(record, output=factor * record.output) for record in data.records)
    return scaled, replace(data, parts=parts, records=records)


def _instruments(machine: MovingMachine, data: Prepared, notes: list[str]) -> tuple[Part, Part] | None:
    """The parts, with the regressors of the fit projected on instruments where least squares are biased; else None.

    What is held out chooses nothing and keeps the regressors that were measured.
    """
    logs, dt, fit = machine.log_set, machine.dt, data.parts[0]
    if logs.control_mode != "position":
        return None
    commands = [t.trajectory.position_command[:, data.j] for t in logs.trials]
    if max(np.ptp(command) for command in commands) == 0.0:
        return None
    if _noise_share(data, dt) < DOUBTFUL:
        return None
    measured = [t.trajectory.position[:, data.j] for t in logs.trials]
    used = [t.split == "fit" for t in logs.trials]
    paths = simulated(commands, measured, used, dt, data.band.cutoff)
    slow = 1e-6 * max(float(np.max(np.abs(r.view.own.velocity))) for r in data.records)
    records = []
    for record, path in zip(data.records, paths, strict=True):
        own = motion_of(path, dt, data.band.cutoff, slow)
        records.append(replace(record, view=View(own.position - data.mean, own, record.view.others)))
    instruments = data.filtered(records, dt)
    picked = data.group(*BASE, *FRICTION, "coupling")
    linear = np.setdiff1d(np.arange(fit.columns.shape[1]), data.group("stribeck"))
    z = instruments[0].columns[fit.keep]
    x, y = fit.columns[fit.keep], fit.output[fit.keep]
    doubtful = np.searchsorted(picked, data.group("inertia", "coulomb", "viscous"))
    block = blocks(fit.segment[fit.keep], fit.time[fit.keep], BLOCK_S)
    test = endogeneity(x[:, picked], z[:, linear], y, doubtful, block)
    if not test.biased:
        return None
    change = (test.instrumental / test.plain - 1.0)[doubtful]
    said = ", ".join(
        f"{name} {100.0 * c:+.0f} %" for name, c in zip(("inertia", "coulomb", "viscous"), change, strict=True)
    )
    if test.weak:
        notes.append(
            f"noise of the position may bias the estimates ({100.0 * _noise_share(data, dt):.1g} % of the variance of the "
            "acceleration), and the command explains too little of the motion to check it with instruments"
        )
        return None
    notes.append(
        "the noise of the position in the closed loop biases least squares (Durbin–Wu–Hausman test, p "
        f"{test.p:.1g}): the regressors are projected on a motion simulated from the command ({said})"
    )
    columns = fit.columns.copy()
    own = np.arange(data.columns.own)
    columns[np.ix_(fit.keep, own)] = z[:, linear] @ projected(x[:, own], z[:, linear])
    return replace(fit, columns=columns), data.parts[1]


def _noise_share(data: Prepared, dt: float) -> float:
    """Share of the variance of acceleration or velocity, the larger of the two, that the noise of the position makes."""
    fit = data.parts[0]
    shares = []
    for order, name in ((2, "inertia"), (1, "viscous")):
        size = float(np.mean(fit.columns[fit.keep, data.columns.one(name)] ** 2))
        shares.append(passed_noise(data.band, dt, data.low_pass.weights, order) ** 2 / max(size, np.finfo(float).tiny))
    return max(shares)


def _sweep(machine: MovingMachine, data: Prepared, notes: list[str]) -> None:
    """Say so if inertia or friction depend on the cut-off."""
    names = ("inertia", "offset", "coulomb", "viscous")
    fit = data.parts[0]
    sizes = np.sqrt(np.mean(fit.columns[np.ix_(fit.keep, data.group(*names))] ** 2, axis=0))
    torque = float(np.std(fit.output[fit.keep]))
    found, errors, lows = [], [], []
    for factor in SWEEP:
        low_pass = ParallelFilter.of(factor * UNDER_CUTOFF * data.band.cutoff, machine.dt)
        own = tuple(data.columns.functions[k] for k in data.group(*names))
        columns = Columns({}, own, np.zeros(0), data.columns.coupling)
        part = part_of(data.records, False, columns, Filters(data.band.cutoff, low_pass), machine.dt, data.mean)
        if len(part.keep) < LEAST_SAMPLES:
            return
        x, y = part.columns[part.keep], part.output[part.keep]
        found.append(robust_fit(x, y))
        block = blocks(part.segment[part.keep], part.time[part.keep], BLOCK_S)
        errors.append(np.sqrt(np.maximum(np.diag(standard_errors(x, y - x @ found[-1], block)), 0.0)))
        lows.append(factor * UNDER_CUTOFF * data.band.cutoff)
    found, errors = ([values[: len(sizes)] for values in each] for each in (found, errors))
    change = np.abs(found[1] - found[0])
    clear = (
        (change > CHANGED * np.hypot(*errors))
        & (change > STABLE * np.abs(found[0]))
        & (change * sizes > STABLE * torque)
    )
    said = [
        f"{name} {found[0][k]:.3g} and {found[1][k]:.3g}"
        for k, name in ((0, "inertia"), (2, "dry friction"), (3, "viscous friction"))
        if clear[k]
    ]
    if said:
        notes.append(
            f"the fit of base, dry and viscous friction depends on the filter ({lows[0]:.2g} and {lows[1]:.2g} Hz: "
            f"{', '.join(said)}): something of these motions is not in it"
        )


def _noise(data: Prepared, dt: float, part: Part, heldout: bool, coefficients: np.ndarray, residual: float) -> float:
    """Root mean square that noise of torque and position leaves after the filter.

    The density of the torque's noise is taken from the octave above the motion, where no model predicts anything; but the
    noise is no more than the residual of all shapes together: a controller's answer to noise is torque that moves the joint.
    """
    records = [record for record in data.records if record.heldout == heldout]
    weights = data.low_pass.weights
    if not len(part.keep):
        return 0.0
    above = (data.band.cutoff, min(2.0 * data.band.cutoff, 0.45 / dt))
    density = noise_density([np.where(r.usable, r.output, 0.0) for r in records], dt, *above)
    torque = float(np.sqrt(density * np.sum(weights**2) * 0.5 / dt))
    inertia, viscous = coefficients
    acceleration = inertia * passed_noise(data.band, dt, weights, 2)
    velocity = viscous * passed_noise(data.band, dt, weights, 1)
    return min(float(np.sqrt(torque**2 + acceleration**2 + velocity**2)), residual)


def _nuisances(data: Prepared) -> tuple[Nuisance, Nuisance]:
    """What other joints may do to the fit and the held-out samples; each has coefficients of its own, of the same prior."""
    fit, own = data.parts[0], data.group(*BASE, *FRICTION, "stribeck")
    terms = [part.columns[np.ix_(part.keep, data.group("coupling"))] for part in data.parts]
    size = np.sqrt(np.mean(terms[0] ** 2, axis=0))
    terms = [columns[:, size > 0.0] / size[size > 0.0] for columns in terms]
    if not terms[0].size:
        return tuple(Nuisance.of(columns[:, :0], 1.0) for columns in terms)
    ridge = ridge_of(terms[0], fit.columns[np.ix_(fit.keep, own)], fit.output[fit.keep])
    return tuple(Nuisance.of(columns, ridge) for columns in terms)


def _scale(data: Prepared, dt: float) -> tuple[Scale, np.ndarray, float]:
    """Sizes of the joint's signals, (K,) root mean squares of the columns, and that of the residual of all columns together."""
    fit = data.parts[0]
    kept, measured = fit.columns[fit.keep], fit.output[fit.keep]
    scale = Scale(
        torque=max(float(np.std(measured)), np.finfo(float).tiny),
        largest=float(np.quantile(np.abs(measured), TOP)),
        speed=float(np.sqrt(np.mean(fit.velocity[fit.keep] ** 2))),
        travel=max(float(np.std(fit.position[fit.keep])), np.finfo(float).tiny),
        seconds=float(np.median([len(r.output) for r in data.records])) * dt,
        step=dt,
    )
    residual = float(np.sqrt(np.mean((measured - kept @ least_squares(kept, measured)) ** 2)))
    return scale, np.sqrt(np.mean(kept**2, axis=0)), residual


def _model(
    machine: MovingMachine,
    joint: str,
    output: Output,
    data: Prepared,
    projection: tuple[Part, Part] | None,
    unsigned: bool,
    notes: list[str],
    window_s: float | None,
    without: Collection[str],
) -> MotionModel:
    fit = data.parts[0]
    if both_ways(fit, data.columns):
        notes.append("a constant torque and a friction that differs by direction are the same in these logs")
    found, _, _ = _first(data, *BASE, *FRICTION, "coupling")
    friction = len(data.group(*BASE))
    inertia, dry, viscous = found[[0, friction, friction + 1]].tolist()
    if inertia < 0.0 and dry < 0.0:
        raise Unjudged("its torque acts against its motion: one of the two has the wrong sign")
    first, _, _ = _first(data, *BASE, "coupling")
    start = dict(zip(("inertia_kg_m2", "offset_nm", "gravity_sin_nm", "gravity_cos_nm"), first.tolist(), strict=False))
    known_load = bool(output.moment) and output.unit != AMPERE
    if known_load:
        start["gravity_angle_rad"] = float(np.arctan2(start["gravity_cos_nm"], start["gravity_sin_nm"]))
    scale, size, residual = _scale(data, machine.dt)
    effects = effects_of(output, data.columns, scale, size, known_load, lambda name: name not in without)
    nuisances = _nuisances(data)
    effects, said = distinguished(effects, fit, data.columns, data.group(*BASE), nuisances[0])
    step = data.low_pass.step * machine.dt
    back = max(1, round((window_s or max(LEAST_WINDOW_S, data.low_pass.length * machine.dt)) / step))
    return MotionModel(
        joint=joint,
        unit=output.unit,
        dt=step,
        base=base_parameters(output, data.columns, start, scale.largest, machine.dt),
        effects=effects,
        fit=data.parts[0].samples(back),
        heldout=data.parts[1].samples(back),
        noise=tuple(
            _noise(data, machine.dt, part, k == 1, np.array([inertia, viscous]), residual)
            for k, part in enumerate(data.parts)
        ),
        notes=tuple(notes + said),
        unsigned=unsigned,
        instrumental=projection is not None,
        parts=projection or data.parts,
        nuisances=nuisances,
        columns=data.columns,
        load=(output.moment, output.inertia) if known_load else (0.0, 0.0),
        back=back,
        mean=data.mean,
    )
