"""Columns that need a first fit, or the time.

Friction that grows with load, friction that changes in the course of a trial, and a torque that is periodic in the position.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hqpipe.layers.joint_motion.coupling import ridge_of, term_sizes
from hqpipe.layers.joint_motion.first_fit import least_squares, robust_fit
from hqpipe.layers.joint_motion.prepared import BASE, FRICTION, Prepared
from hqpipe.layers.joint_motion.records import Part, Record, cut

LOCKED = 0.9  # most friction per torque in a first fit: at 1 a gear locks itself
TURNS = 2  # of a fit and the load that follows from it: each leaves a tenth of the error, the share of the friction
CHUNK = 50_000  # samples at a time: a hundred terms of other joints over an hour at 1 kHz would not fit into memory
FEWEST_PERIODS = 3.0  # of a ripple over the travel; assumption: what is slower is a gravity, a spring or their shape
PER_PERIOD = 6.0  # filtered samples that a period must have at the rms speed: the filter halves such a wave
STEP = 0.5  # periods over the travel between the waves that are tried: half of what the travel can resolve


def with_fitted_columns(data: Prepared) -> Prepared:
    """The joint with the groups "load", "halves" and, if a wave can be seen, "ripple" behind its other columns.

    The friction that grows with load is |τ|·sgn v at the rate of the log, which then passes the filter as everything does: a
    product of two filtered signals is not the filtered product at reversals. τ is the torque of the motor by a first fit,
    friction and other joints with it; the measured one in its place would bring the errors of the model into the column.
    """
    own = data
    for _ in range(TURNS):
        coefficients = _load_coefficients(data)
        loads = [_load(record, data, coefficients) for record in data.records]
        rows = [(load * r.view.own.direction)[None] for load, r in zip(loads, data.records, strict=True)]
        data = _appended(own, "load", rows)
    data = _appended(data, "halves", [_halves(record) for record in data.records])
    wave = _wave(data)
    if wave is None:
        return data
    waves = [np.array([np.sin(wave * r.view.x), np.cos(wave * r.view.x)]) for r in data.records]
    return _appended(data, "ripple", waves)


def with_columns_of(part: Part, other: Part, count: int) -> Part:
    """A part with the last columns of another with the same samples, which has `count` more."""
    return replace(part, columns=np.hstack([part.columns, other.columns[:, -count:]])) if count else part


def _load_coefficients(data: Prepared) -> np.ndarray:
    """Of the columns of base, friction and other joints and, last, of the friction that grows with load; of the fit samples."""
    fit = data.parts[0]
    columns, torque = fit.columns[fit.keep], fit.output[fit.keep]
    own, terms = columns[:, data.group(*BASE, *FRICTION)], columns[:, data.group("coupling")]
    size = term_sizes(*(part.columns[np.ix_(part.keep, data.group("coupling"))] for part in data.parts))
    if data.columns["load"]:
        grown = columns[:, data.columns.one("load")]
    else:
        found = _beside_others(own, terms, size, torque)
        grown = np.abs(np.column_stack([own, terms]) @ found) * columns[:, data.columns.one("coulomb")]
    found = _beside_others(np.column_stack([own, grown]), terms, size, torque)
    count = own.shape[1]
    return np.concatenate([found[:count], found[count + 1 :], found[count : count + 1]])


def _beside_others(own: np.ndarray, terms: np.ndarray, size: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Coefficients of the joint's own columns, then of the terms of other joints, which have a prior: see `ridge_of`.

    Without it a hundred terms would say of other motions what no fit can know.
    """
    if not np.any(terms):
        return np.concatenate([robust_fit(own, torque), np.zeros(terms.shape[1])])
    ridge = ridge_of(terms / size, own, torque)
    held = np.hstack([np.zeros((terms.shape[1], own.shape[1])), np.diag(np.sqrt(ridge) * size)])
    both = np.vstack([np.hstack([own, terms]), held])
    return least_squares(both, np.concatenate([torque, np.zeros(terms.shape[1])]))


def _load(record: Record, data: Prepared, coefficients: np.ndarray) -> np.ndarray:
    """(T,) |τ| at the rate of the log, where τ = w + μ|τ|·sgn v and w is all the rest."""
    picked, found = data.group(*BASE, *FRICTION, "coupling"), []
    for start in range(0, len(record.output), CHUNK):
        view = cut(record.view, start, start + CHUNK)
        rest = coefficients[:-1] @ data.columns.of(view)[picked]
        share = np.clip(coefficients[-1], 0.0, LOCKED) * view.own.direction * np.sign(rest)
        found.append(np.abs(rest) / (1.0 - share))
    return np.concatenate(found)


def _halves(record: Record) -> np.ndarray:
    """(2, T) dry and viscous friction, of which half is taken from the first half of a trial and given to the second."""
    own, samples = record.view.own, len(record.output)
    half = np.where(np.arange(samples) < samples // 2, -0.5, 0.5)
    return np.array([half * own.direction, half * own.velocity])


def _wave(data: Prepared) -> float | None:
    """Radians of phase per radian of the wave in the position that takes most off the residual; None if none can be seen."""
    fit = data.parts[0]
    rows, torque = fit.columns[fit.keep], fit.output[fit.keep]
    residual = torque - rows @ robust_fit(rows, torque)
    x = fit.position[fit.keep] - data.mean
    travel, speed = float(np.ptp(x)), float(np.sqrt(np.mean(fit.velocity[fit.keep] ** 2)))
    step = float(np.median(np.diff(fit.time)))
    most = travel / (PER_PERIOD * speed * step)
    periods = np.arange(FEWEST_PERIODS, most, STEP)
    if not len(periods) or len(x) < len(rows.T) + 2:
        return None
    left = []
    for count in periods:
        both = np.column_stack([np.sin(2.0 * np.pi * count * x / travel), np.cos(2.0 * np.pi * count * x / travel)])
        left.append(float(np.sum((residual - both @ least_squares(both, residual)) ** 2)))
    return float(2.0 * np.pi * periods[int(np.argmin(left))] / travel)


def _appended(data: Prepared, group: str, rows: Sequence[np.ndarray]) -> Prepared:
    """With more columns, given as (K, T) at the rate of the log for each record."""
    count = data.parts[0].columns.shape[1]
    groups = data.columns.groups | {group: tuple(range(count, count + len(rows[0])))}
    parts = tuple(_filtered(part, data, rows) for part in data.parts)
    return replace(data, columns=replace(data.columns, groups=groups), parts=parts)


def _filtered(part: Part, data: Prepared, rows: Sequence[np.ndarray]) -> Part:
    from scipy.signal import fftconvolve

    found = np.zeros((len(part.centre), len(rows[0])))
    for k in np.unique(part.record):
        here = part.record == k
        passed = fftconvolve(rows[k], data.low_pass.weights[None], "same", axes=1)
        found[here] = passed[:, part.centre[here]].T
    return replace(part, columns=np.hstack([part.columns, found]))
