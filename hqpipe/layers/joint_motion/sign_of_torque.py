"""Torques of which only the size was logged, and their sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.layers.joint_motion.columns import Columns, View
from hqpipe.layers.joint_motion.first_fit import least_squares
from hqpipe.layers.joint_motion.records import Part, Record

NEVER = 1e-9  # of the largest value: as negative as rounding makes a channel
BETTER = 0.85  # of the squared error that signs may leave; assumption: less of a gain may be what a model lacks
BOTH = 0.03  # of the torque, by size, that must come out with either sign; assumption
TURNS = 30
SHAPES = ("inertia", "offset", "gravity", "coulomb", "viscous")


@dataclass(frozen=True, eq=False)
class Signs:
    """Attributes:
    coefficients: of the columns of `SHAPES`, with which the sign of the torque is predicted.
    columns: their indices. error: root mean square of the sizes that they leave.
    share: of the torque, by size, that is negative.
    """

    coefficients: np.ndarray
    columns: np.ndarray
    error: float
    share: float

    def restored(self, record: Record, columns: Columns) -> Record:
        """The record with signed torque; samples whose sign is within the error are no evidence."""
        predicted = self.predicted(record.view, columns)
        clear = np.abs(predicted) > self.error
        return replace(record, output=np.sign(predicted) * record.output, usable=record.usable & clear)

    def predicted(self, view: View, columns: Columns) -> np.ndarray:
        """(T,) torque, at the rate of the log."""
        rows = np.array([np.broadcast_to(columns.functions[k](view), view.x.shape) for k in self.columns])
        return self.coefficients @ rows


def never_negative(outputs: Sequence[np.ndarray]) -> bool:
    """Whether no trial has a torque below zero."""
    top = max(float(np.nanmax(values)) for values in outputs)
    return top > 0.0 and min(float(np.nanmin(values)) for values in outputs) >= -NEVER * top


def lost_signs(part: Part, columns: Columns, pull: np.ndarray | None) -> Signs | None:
    """The signs with which base and friction explain a torque that is never negative; None where it has its sign.

    Sign and coefficients are fitted in turns from several first guesses. Two readings that agree while the joint moves, friction
    and constant load exchanged, differ at rest: there the size of the torque lies between load less friction and load plus
    friction. The sign of the whole is that with which friction dissipates.

    Args:
        part: with the torque as logged. pull: (N,) position error of the drive, or None.
    """
    picked = np.array([k for name in SHAPES for k in columns[name]])
    x, size = part.columns[:, picked], part.output
    keep = part.keep
    rest = np.flatnonzero((part.rest > 0.99) & (size > 0.0))
    direction = part.columns[:, columns.one("coulomb")]
    if len(keep) < 10 * len(picked) or not (np.any(direction[keep] > 0.5) and np.any(direction[keep] < -0.5)):
        return None
    guesses = [np.ones(len(size)), np.where(direction < 0.0, -1.0, 1.0)]
    if pull is not None:
        guesses += [np.where(pull < level, -1.0, 1.0) for level in (0.0, float(np.median(pull)))]
    still = [k for k, index in enumerate(picked) if index in (columns.one("coulomb"), columns.one("viscous"), 0)]
    friction = int(np.flatnonzero(picked == columns.one("coulomb"))[0])
    tried = []
    for guess in guesses:
        found = _in_turns(x[keep], size[keep], guess[keep])
        load = np.abs(np.delete(x[rest], still, axis=1) @ np.delete(found, still))
        off = np.abs(size[rest] - load) - abs(found[friction])
        moving = np.abs(x[keep] @ found) - size[keep]
        cost = float(np.sum(moving**2) + np.sum(np.maximum(off, 0.0) ** 2)) / (len(keep) + len(rest))
        tried.append((cost, found))
    plain = tried[0]
    cost, found = min(tried, key=lambda entry: entry[0])
    if cost >= BETTER * plain[0]:
        cost, found = plain
    found = -found if found[friction] < 0.0 else found
    torque = x[keep] @ found
    share = float(size[keep][torque < 0.0].sum() / size[keep].sum())
    if share < BOTH:
        return None
    return Signs(found, picked, float(np.sqrt(cost)), share)


def _in_turns(x: np.ndarray, size: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Coefficients of a local optimum of (|x·c| − size)²."""
    found = least_squares(x, signs * size)
    for _ in range(TURNS):
        changed = np.where(x @ found < 0.0, -1.0, 1.0)
        if np.array_equal(changed, signs):
            break
        signs = changed
        found = least_squares(x, signs * size)
    return found
