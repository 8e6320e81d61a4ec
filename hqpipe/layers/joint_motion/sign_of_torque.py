"""Torques of which only the size was logged, and their sign."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.layers.joint_motion.columns import Columns, View
from hqpipe.layers.joint_motion.first_fit import NORMAL_MAD
from hqpipe.layers.joint_motion.records import Record, cut

NEVER = 1e-9  # of the largest value: as negative as rounding makes a channel
BETTER = 0.85  # of the squared error that signs may leave; assumption: less of a gain may be what a model lacks
BOTH = 0.03  # of the torque, by size, that must come out with either sign; assumption
TURNS = 30  # assumption: signs that still change then are those of torques near zero
RANDOM = 20  # further guesses: planes through the columns; assumption: one of them lies near the best reading
SAME = 0.98  # of the signs that two readings share; assumption: they end in one
REFINED = 4  # different readings that are fitted beside other joints; assumption: the right one is among the best
CHUNK = 50_000  # samples at a time: a hundred terms of other joints over an hour at 1 kHz would not fit into memory
MOST_ROWS = 30_000  # of the search, evenly spaced
SHAPES = ("inertia", "offset", "gravity", "spring", "coulomb", "viscous")


@dataclass(frozen=True, eq=False)
class Signs:
    """How the sign of a torque is restored.

    Attributes:
        coefficients: (K,) with which the sign of the torque is predicted.
        columns: (K,) their indices: those of `SHAPES`, and the terms of other joints where there are any.
        error: standard deviation of the sizes about theirs, by the median. share: of the torque, by size, that is negative.
    """

    coefficients: np.ndarray
    columns: np.ndarray
    error: float
    share: float

    def restored(self, record: Record, columns: Columns) -> Record:
        """The record with signed torque; a large one whose sign is in doubt is no evidence, near zero it matters little."""
        predicted = self.predicted(record.view, columns)
        clear = (np.abs(predicted) > self.error) | (record.output <= self.error)
        return replace(record, output=np.sign(predicted) * record.output, usable=record.usable & clear)

    def predicted(self, view: View, columns: Columns) -> np.ndarray:
        """(T,) torque, at the rate of the log."""
        return np.concatenate([self.coefficients @ rows for _, rows in _rows(view, columns, self.columns)])


def never_negative(outputs: Sequence[np.ndarray]) -> bool:
    """Whether no trial has a torque below zero."""
    top = max(float(np.nanmax(values)) for values in outputs)
    return top > 0.0 and min(float(np.nanmin(values)) for values in outputs) >= -NEVER * top


def lost_signs(records: Sequence[Record], columns: Columns, pulls: Sequence[np.ndarray] | None) -> Signs | None:
    """The signs with which base and friction explain a torque that is never negative; None where it has its sign.

    At the rate of the log, because the mean of a size is not the size of a mean. Sign and coefficients are fitted in turns from
    several first guesses, of the joint by itself; then beside what other joints do. Two readings that agree while the joint
    moves, friction and constant load exchanged, differ at rest: there the size of the torque lies between load less friction
    and load plus friction. The sign of the whole is that with which friction dissipates.

    Args:
        records: of the fit, with the torque as logged. pulls: (T,) of each, position error of the drive, or None.
    """
    picked = np.array([k for name in SHAPES for k in columns[name]])
    usable = np.concatenate([r.usable for r in records])
    usable &= np.arange(len(usable)) % -(-len(usable) // MOST_ROWS) == 0
    split = np.split(usable, np.cumsum([len(r.usable) for r in records])[:-1])
    size = np.concatenate([r.output for r in records])[usable]
    x = _picked_rows(records, columns, picked, split)
    still = np.concatenate([r.view.own.rest for r in records])[usable]
    direction = np.where(np.concatenate([r.view.own.direction for r in records])[usable] < 0.0, -1.0, 1.0)
    guesses = [np.ones(len(size)), direction, np.where(x[:, 0] < 0.0, -1.0, 1.0)]
    if pulls is not None:
        pull = np.concatenate(pulls)[usable]
        guesses += [np.where(pull < level, -1.0, 1.0) for level in (0.0, float(np.median(pull)))]
    if len(size) < 10 * len(picked) or still.all() or abs(np.mean(direction[~still])) > 1.0 - BOTH:
        return None
    posture = np.isin(picked, [*columns["offset"], *columns["gravity"], *columns["spring"]])
    readings = _readings(x, size, still, guesses, posture, int(np.flatnonzero(picked == columns.one("coulomb"))[0]))
    size, x, found = size[~still], x[~still], readings[0]
    torque = x @ found
    if size[torque < 0.0].sum() < BOTH * size.sum():
        return None
    if columns["coupling"]:
        picked = np.append(picked, columns["coupling"])
        rows = _picked_rows(records, columns, picked, split)[~still]
        found = _beside_others(rows, size, [np.where(x @ reading < 0.0, -1.0, 1.0) for reading in readings])
        torque = rows @ found
    error = NORMAL_MAD * float(np.median(np.abs(np.abs(torque) - size)))
    return Signs(found, picked, error, float(size[torque < 0.0].sum() / size.sum()))


def _readings(
    x: np.ndarray, size: np.ndarray, still: np.ndarray, guesses: list[np.ndarray], posture: np.ndarray, friction: int
) -> list[np.ndarray]:
    """Coefficients from each of the guesses, the best first; only the first where none is clearly better than that.

    A reading in which friction dissipates and the inertia is negative is none.

    Args:
        x: (N, K) columns, the acceleration first and the speed last. size: (N,) of the torque. still: (N,) at rest.
        guesses: (N,) signs, the first those of a torque that was never negative.
        posture: (K,) which columns hold at rest. friction: index of the dry friction.
    """
    moving, rng = x[~still], np.random.default_rng(0)
    planes = rng.standard_normal((RANDOM, x.shape[1])) / np.maximum(np.sqrt(np.mean(moving**2, axis=0)), 1e-300)
    starts = [guess[~still] for guess in guesses] + [np.where(moving @ plane < 0.0, -1.0, 1.0) for plane in planes]
    tried, speed = [], moving[:, -1]
    for start in starts:
        found = _in_turns(moving, size[~still], start)
        off = np.abs(size[still] - np.abs(x[still][:, posture] @ found[posture])) - abs(found[friction])
        error = np.abs(moving @ found) - size[~still]
        power = found[friction] * np.mean(np.abs(speed)) + found[-1] * np.mean(speed**2)
        found = -found if power < 0.0 else found
        cost = float(np.sum(error**2) + np.sum(np.maximum(off, 0.0) ** 2)) / len(size)
        tried.append((bool(found[0] < 0.0), cost, found))
    plain = tried[0]
    tried.sort(key=lambda entry: entry[:2])
    if tried[0][0] or tried[0][1] >= BETTER * plain[1]:
        return [plain[2]]
    return [found for against, _, found in tried if not against]


def _beside_others(rows: np.ndarray, size: np.ndarray, starts: list[np.ndarray]) -> np.ndarray:
    """Coefficients of own columns and terms of other joints, of the best of the first few different starts.

    Args:
        rows: (N, K), the acceleration first. size: (N,) of the torque. starts: (N,) signs.
    """
    different: list[np.ndarray] = []
    for start in starts:
        if all(np.mean(start == other) < SAME for other in different):
            different.append(start)
    tried = []
    for start in different[:REFINED]:
        found = _in_turns(rows, size, start)
        tried.append((bool(found[0] < 0.0), float(np.mean((np.abs(rows @ found) - size) ** 2)), found))
    return min(tried, key=lambda entry: entry[:2])[2]


def _rows(view: View, columns: Columns, picked: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
    """Stretches of a trial, and (K, T) columns at the rate of the log in each."""
    for start in range(0, len(view.x), CHUNK):
        part = cut(view, start, start + CHUNK)
        if picked[-1] < columns.own:
            rows = np.array([np.broadcast_to(columns.functions[k](part), part.x.shape) for k in picked])
        else:
            rows = columns.of(part)[picked]
        yield slice(start, start + CHUNK), rows


def _picked_rows(
    records: Sequence[Record], columns: Columns, picked: np.ndarray, usable: Sequence[np.ndarray]
) -> np.ndarray:
    """(N, K) columns of the usable samples of all records."""
    found = [
        rows[:, keep[here]].T
        for record, keep in zip(records, usable, strict=True)
        for here, rows in _rows(record.view, columns, picked)
    ]
    return np.concatenate(found)


def _in_turns(x: np.ndarray, size: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Coefficients of a local optimum of (|x·c| − size)²."""
    scale = np.sqrt(np.mean(x**2, axis=0))
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv((x / scale).T @ (x / scale), rcond=1e-11, hermitian=True)

    def fitted(signs: np.ndarray) -> np.ndarray:
        return inverse @ ((signs * size) @ x / scale) / scale

    found = fitted(signs)
    for _ in range(TURNS):
        changed = np.where(x @ found < 0.0, -1.0, 1.0)
        if np.array_equal(changed, signs):
            break
        signs = changed
        found = fitted(signs)
    return found
