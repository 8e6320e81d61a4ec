"""From the motion of a machine and the torque of one joint to its model."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hqpipe.layers.joint_motion.bandwidth import noise_density, passed_noise
from hqpipe.layers.joint_motion.candidates import Scale, base_parameters, effects_of
from hqpipe.layers.joint_motion.coupling import Nuisance, Predicted, ridge_of, term_sizes
from hqpipe.layers.joint_motion.distinct import both_ways, distinguished
from hqpipe.layers.joint_motion.filter_sweep import note_sweep
from hqpipe.layers.joint_motion.first_fit import least_squares
from hqpipe.layers.joint_motion.fitted_columns import with_columns_of, with_fitted_columns
from hqpipe.layers.joint_motion.instruments import instrumental_parts, projected
from hqpipe.layers.joint_motion.model import MotionModel
from hqpipe.layers.joint_motion.output import AMPERE, Output, output_of
from hqpipe.layers.joint_motion.prepared import (
    BASE,
    FRICTION,
    SIGNED,
    TOP,
    Prepared,
    Unjudged,
    check,
    first_fit,
    prepare,
    without_bursts,
)
from hqpipe.layers.joint_motion.records import Part
from hqpipe.layers.joint_motion.sign_of_torque import Signs, lost_signs, never_negative

if TYPE_CHECKING:
    from hqpipe.layers.joint_motion.joint_motion import MovingMachine

CLEAR = 5.0  # standard errors of the gravity that fixes a scale: 20 % would be no scale
AGAINST = 3.0  # standard errors by which inertia and dry friction are both negative: never by chance in normal errors
LEAST_WINDOW_S = 0.1  # over which persistence is asked, that of the other layers


def judge(machine: MovingMachine, joint: str, window_s: float | None, without: Collection[str]) -> MotionModel:
    """The model of one joint.

    Raises:
        Unjudged: it does not move enough.
    """
    output = output_of(machine.log_set, joint)
    joint_data = prepare(machine, joint, output)
    notes = list(output.notes)
    signs = _signs(machine, joint_data, output)
    if signs:
        records = tuple(signs.restored(record, joint_data.columns) for record in joint_data.records)
        joint_data = replace(joint_data, records=records, parts=joint_data.filtered(records, machine.dt))
        notes.append(
            "only the size of the torque was logged; its sign is the one with which inertia, gravity and friction explain it "
            f"best ({100.0 * signs.share:.0f} % of it negative), and samples in which the sign is in doubt are left out"
        )
    check(joint_data, machine, bool(signs))
    joint_data = without_bursts(joint_data, machine.dt, notes)
    output, joint_data = _in_newton_metres(output, joint_data, notes)
    projection = instrumental_parts(machine, joint_data, notes)
    before = joint_data.parts[0].columns.shape[1]
    joint_data = with_fitted_columns(joint_data)
    if projection:
        added = joint_data.parts[0].columns.shape[1] - before
        pairs = zip(projection, joint_data.parts, strict=True)
        projection = tuple(with_columns_of(part, other, added) for part, other in pairs)
    note_sweep(machine, joint_data, notes)
    return _model(machine, joint, output, joint_data, projection, bool(signs), notes, window_s, without)


def _in_newton_metres(output: Output, data: Prepared, notes: list[str]) -> tuple[Output, Prepared]:
    """A current as torque, where a known load gives its scale."""
    if output.unit != AMPERE or not output.moment:
        return output, data
    found, errors, _ = first_fit(data, "inertia", "offset", "gravity", "coulomb", "viscous")
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
    fit, dt = data.parts[0], machine.dt
    own = _moving_numbers(data, unsigned)
    known_load = bool(output.moment) and output.unit != AMPERE
    scale, size, residual = _scale(data, dt)
    effects = effects_of(output, data.columns, scale, size, known_load, lambda name: name not in without)
    nuisances = nuisances_of(data)
    told = distinguished(effects, fit, data.columns, data.group(*BASE), nuisances[0])
    step = data.low_pass.step * dt
    back = max(1, round((window_s or max(LEAST_WINDOW_S, data.low_pass.length * dt)) / step))
    return MotionModel(
        joint=joint,
        unit=output.unit,
        dt=step,
        base=base_parameters(output, data.columns, _start(data, known_load), scale.largest, dt),
        effects=told.effects,
        same=told.same,
        fit=data.parts[0].samples(back),
        heldout=data.parts[1].samples(back),
        noise=tuple(_noise(data, dt, part, k == 1, own, residual) for k, part in enumerate(data.parts)),
        notes=tuple([*notes, *_said(machine, data), *told.notes]),
        unsigned=unsigned,
        instrumental=projection is not None,
        parts=projection or data.parts,
        measured=data.parts,
        nuisances=nuisances,
        columns=data.columns,
        load=(output.moment, output.inertia) if known_load else (0.0, 0.0),
        back=back,
        mean=data.mean,
    )


def _moving_numbers(data: Prepared, unsigned: bool) -> np.ndarray:
    """(2,) inertia and viscous friction of a first fit.

    Raises:
        Unjudged: inertia and dry friction are both clearly negative; or the inertia, where the sign of the torque was restored.
    """
    found, errors, _ = first_fit(data, *BASE, *FRICTION, "coupling")
    friction = len(data.group(*BASE))
    if unsigned and found[0] < -AGAINST * errors[0]:
        raise Unjudged(
            "its torque was logged without its sign, and with the sign that fits best its inertia is negative", SIGNED
        )
    both = [0, friction]
    if not unsigned and np.all(found[both] < -AGAINST * errors[both]):
        raise Unjudged("its torque acts against its motion: one of the two has the wrong sign", "correct that sign")
    return found[[0, friction + 1]]


def _start(data: Prepared, known_load: bool) -> dict[str, float]:
    """Name → value of a first fit of the base."""
    first, _, _ = first_fit(data, *BASE, "coupling")
    start = dict(zip(("inertia_kg_m2", "offset_nm", "gravity_sin_nm", "gravity_cos_nm"), first.tolist(), strict=False))
    if known_load:
        start["gravity_angle_rad"] = float(np.arctan2(start["gravity_cos_nm"], start["gravity_sin_nm"]))
    return start


def _said(machine: MovingMachine, data: Prepared) -> list[str]:
    """What to know of the model."""
    found = []
    if both_ways(data.parts[0], data.columns):
        found.append("a constant torque and a friction that differs by direction are the same in these logs")
    if data.columns["coupling"]:
        found.append(
            "what the motion of the other joints does to it is taken out of the errors, by terms of the dynamics of a chain "
            "of unknown geometry"
        )
    elif sum(band is not None for band in machine.bandwidths) > 1:
        found.append("the log is too short to tell what the motion of the other joints does to it")
    return found


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


def nuisances_of(data: Prepared) -> tuple[Nuisance, Predicted]:
    """What other joints may do to the fit and to the held-out samples.

    The terms are taken less what inertia, gravity and a constant hold of them, which so mean the postures of the fit.
    """
    fit, own = data.parts[0], data.group(*BASE, *FRICTION, "stribeck")
    terms = [part.columns[np.ix_(part.keep, data.group("coupling"))] for part in data.parts]
    base = [part.columns[np.ix_(part.keep, data.group(*BASE))] for part in data.parts]
    held = projected(terms[0], base[0]) if terms[0].size else np.zeros((base[0].shape[1], 0))
    terms = [columns - rows @ held for columns, rows in zip(terms, base, strict=True)]
    size = term_sizes(*terms)
    terms = [columns / size for columns in terms]
    if not terms[0].size:
        return Nuisance.of(terms[0][:, :0], 1.0), Predicted.of(terms[0][:, :0], terms[1][:, :0], 1.0)
    ridge = ridge_of(terms[0], fit.columns[np.ix_(fit.keep, own)], fit.output[fit.keep])
    return Nuisance.of(terms[0], ridge), Predicted.of(terms[0], terms[1], ridge)


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
