"""Effort against the chamber pressures, where both were recorded.

A gain or an offset of the torque sensor hides in the coefficients of any actuator model, which are fitted to that same
torque. A second measurement of the torque tells them apart: effort = c_a p_a − c_b p_b + offset, with the
friction of the pistons (its sign and its rate with the speed) beside it where the effort is a load cell's. The
coefficients are area × lever arm, which need not be known: a joint is compared with those of its name on other legs, which have
the same cylinder. Where there are no three of a kind whose coefficients agree, as with two legs, nothing is said.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.gap.checks.sensing import skew
from hqpipe.gap.residuals.bootstrap import BLOCK_S, block_weights, interval
from hqpipe.identify.uncertainty import NORMAL
from hqpipe.logs.end_stops import at_end_stop
from hqpipe.logs.trajectory import LogSet, Trajectory

MEAN_S = 0.01  # over which effort and pressures are averaged, so that a skew of a few ms does not count as error
SIGMAS = 5.0  # from zero or from the other joints, by bootstrap and by the scatter of those joints
LEAST_RATIO = 0.03
"""Of a gain: load cells and pressure sensors are good to about 1 % each, and two joints are compared, so that less is within
their tolerance; assumption. The cost: a gain that is off by less is not told."""
LEAST_OFFSET = 0.01  # of the effort's standard deviation, likewise
MIN_KIND = 3  # joints of one kind, so that one of them can be the odd one
ONE_KIND = 0.05  # scatter of the gains of joints of one kind at most: other designs differ by more; assumption
SIDES = {
    *("l", "r", "f", "h", "m", "left", "right", "front", "hind", "rear", "back", "middle", "fore"),
    *("lf", "rf", "lh", "rh", "fl", "fr", "hl", "hr", "rl", "rr", "lm", "rm", "ml", "mr"),
}
"""Words of a joint's name that say where on the machine it is."""
LEAST_DROP = 0.2  # share of the squared error that a shift must remove; assumption
LEAST_SHARE = 0.02  # of a sample: a parabola through three errors is no better; assumption
ALIKE = 0.9  # squared correlation from which the pressures are the torque's; assumption
SIGN_SHARE = 0.05  # of the speed's standard deviation: width of the step from −1 to 1
MOVING = 0.95  # of that step from which on a joint moves one way all the while that is averaged over; assumption
MIN_BLOCKS = 6
RIDGE = 1e-13  # of the trace: the sum of the pressures is nearly constant, and must not be pulled towards zero


@dataclass(frozen=True)
class CrossCheck:
    """One figure of one joint.

    Attributes:
        effect: "torque_scale", "torque_bias" or "channel_skew".
        joint: its name.
        value: ratio of the gain to that of its kind, offset in N·m, or s that effort is later than pressure.
        unit: "1", "N·m" or "s".
        low, high: 95 % interval, block bootstrap; of the blocks' own lags for a skew.
        significant: whether it differs from a sound sensor's for certain.
        compared_with: what the value was measured against.
    """

    effect: str
    joint: str
    value: float
    unit: str
    low: float
    high: float
    significant: bool
    compared_with: str


@dataclass(frozen=True, eq=False)
class _Line:
    """Bootstrap samples of one joint's gain (D,) N·m/Pa and offset (D,) N·m, and their estimates."""

    gain: float
    gains: np.ndarray
    offset: float
    offsets: np.ndarray
    spread: float


def cross_check(log_set: LogSet, *, nominal: Mapping[str, float] | None = None) -> list[CrossCheck]:
    """Compare effort with the chamber pressures, joint by joint.

    Args:
        log_set: of which effort, pressure_a and pressure_b are used; without them nothing is returned.
        nominal: joint → area × lever arm, N·m/Pa, where it is known; it takes the place of the other joints.
    """
    trials = [t.trajectory for t in log_set.trials]
    if any(getattr(trials[0], name) is None for name in ("effort", "pressure_a", "pressure_b")):
        return []
    late = {joint: _late(trials, j, joint) for j, joint in enumerate(log_set.joints)}
    rubbed = log_set.effort_source == "load_cell"
    lines = {joint: _line(trials, j, late[joint].value, rubbed) for j, joint in enumerate(log_set.joints)}
    known = {joint: line for joint, line in lines.items() if line is not None}
    found = []
    for joint, line in known.items():
        others = _of_its_kind(joint, known)
        found += _scale(joint, line, others, (nominal or {}).get(joint))
        found.append(_bias(joint, line, others or [known[name] for name in known if name != joint]))
        found.append(late[joint])
    return found


def _of_its_kind(joint: str, known: Mapping[str, _Line]) -> list[_Line]:
    """The other joints of a kind; none where they are too few or their gains differ."""
    others = [line for name, line in known.items() if name != joint and kind_of(name) == kind_of(joint)]
    return others if len(others) >= MIN_KIND - 1 and _scatter(others) <= ONE_KIND else []


def kind_of(joint: str) -> str:
    """What a joint's name says beside its side and number: "K" of "LFK", "knee" of "left_knee", "knee_2" and "a_knee"."""
    if joint[:-1].lower() in SIDES:
        return joint[-1].upper()
    words = [re.sub(r"\d+", "", word) for word in re.split(r"[_\-./ ]", joint.lower())]
    part = [word for word in words if word and word not in SIDES]
    longer = [word for word in part if len(word) > 1]  # beside them, a single letter says which leg
    return "_".join(longer or part)


def _scatter(lines: Sequence[_Line]) -> float:
    """Of the gains, as a share of their median: 1.4826 times the median distance from it."""
    gains = np.array([line.gain for line in lines])
    middle = float(np.median(gains))
    return 1.4826 * float(np.median(np.abs(gains - middle))) / max(abs(middle), np.finfo(float).tiny)


def _line(trials: list[Trajectory], j: int, late: float, rubbed: bool) -> _Line | None:
    """Gain and offset of one joint whose effort is `late` s; None if the pressures say nothing about it.

    Where friction lies between pressures and effort (`rubbed`), a joint says nothing while it rests: friction holds then
    whatever the load asks for.
    """
    rows, block, seen = [], [], 0
    for t in trials:
        every = max(1, round(MEAN_S / t.dt))
        count = t.samples // every
        speed = t.velocity[:, j]
        friction = np.tanh(speed / (SIGN_SHARE * speed.std() + 1e-300))
        sides = [np.ones(t.samples), t.pressure_a[:, j] - t.pressure_b[:, j], t.pressure_a[:, j] + t.pressure_b[:, j]]
        effort = np.interp(t.time + late, t.time, t.effort[:, j])
        columns = np.stack([*sides, friction, speed, effort], axis=1)[: count * every]
        marks = at_end_stop(t)  # a load cell does not feel the oil that rests on the cylinder's own end
        free = np.ones(count, dtype=bool)
        if marks is not None:
            free = ~marks[: count * every, j].reshape(count, every).any(axis=1)
        rows.append(columns.reshape(count, every, -1).mean(axis=1)[free])
        size = max(1, round(BLOCK_S / (every * t.dt)))
        block.append((np.arange(count) // size + seen)[free])
        seen += count // size + 1
    table, member = np.concatenate(rows), np.concatenate(block)
    if rubbed:
        moving = np.abs(table[:, 3]) > MOVING
        table, member = table[moving], member[moving]
    if len(np.unique(member)) < MIN_BLOCKS:
        return None
    table = table[:, [0, 1, 3, 4, 5]] if _same_area(table) else table
    scale = table.std(axis=0) + np.abs(table.mean(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = table / scale
    present = np.unique(member)
    grams = np.array([scaled[member == b].T @ scaled[member == b] for b in present])
    if scaled[:, -1].std() == 0 or scaled[:, 1].std() == 0:
        return None
    draws = np.concatenate([np.ones((1, len(present))), block_weights(len(present))])
    total = np.tensordot(draws, grams, axes=1)
    inner = total[:, :-1, :-1]
    ridge = RIDGE * np.trace(inner, axis1=1, axis2=2)[:, None, None] * np.eye(inner.shape[1])
    slopes = np.linalg.solve(inner + ridge, total[:, :-1, -1:])[..., 0]
    left = total[0, -1, -1] - slopes[0] @ total[0, :-1, -1]
    if left > (1.0 - ALIKE) * np.sum((scaled[:, -1] - scaled[:, -1].mean()) ** 2):
        return None
    gains, offsets = slopes[:, 1] * scale[-1] / scale[1], slopes[:, 0] * scale[-1]
    return _Line(float(gains[0]), gains[1:], float(offsets[0]), offsets[1:], float(table[:, -1].std()))


def _same_area(table: np.ndarray) -> bool:
    """Whether the sum of the pressures explains nothing beside their difference: pistons of one size."""
    y = table[:, -1]
    left = []
    for chosen in ([0, 1, 3, 4], [0, 1, 2, 3, 4]):
        x = table[:, chosen] / (np.abs(table[:, chosen]).max(axis=0) + np.finfo(float).tiny)
        left.append(np.sum((y - x @ np.linalg.lstsq(x, y, rcond=1e-10)[0]) ** 2))
    return bool(left[1] > 0.5 * left[0])


def _scale(joint: str, line: _Line, others: list[_Line], nominal: float | None) -> list[CrossCheck]:
    if nominal is not None:
        reference, scatter, against = nominal, 0.0, "its nominal area × lever arm"
    elif others:
        reference, scatter = float(np.median([other.gain for other in others])), _scatter(others)
        against = f"the median of {len(others)} joints of its kind"
    else:
        return []
    low, high = interval(line.gains / reference)
    ratio, error = line.gain / reference, float(np.std(line.gains) / abs(reference))
    odd = abs(ratio - 1.0) > max(SIGMAS * np.hypot(error, scatter), LEAST_RATIO)
    return [CrossCheck("torque_scale", joint, ratio, "1", float(low), float(high), bool(odd), against)]


def _bias(joint: str, line: _Line, others: list[_Line]) -> CrossCheck:
    offsets = np.array([other.offset for other in others])
    scatter = 1.4826 * float(np.median(np.abs(offsets - np.median(offsets)))) if len(offsets) >= MIN_KIND - 1 else 0.0
    low, high = interval(line.offsets)
    odd = abs(line.offset) > max(SIGMAS * np.hypot(float(np.std(line.offsets)), scatter), LEAST_OFFSET * line.spread)
    return CrossCheck(
        "torque_bias", joint, line.offset, "N·m", float(low), float(high), bool(odd), "effort at equal pressures"
    )


def _late(trials: list[Trajectory], j: int, joint: str) -> CrossCheck:
    """Lag of the effort behind the pressures over all trials, with the scatter of the lags of its parts."""
    pairs = []
    for t in trials:
        speed, change = t.velocity[:, j], np.gradient(t.velocity[:, j], t.dt)
        friction = np.tanh(speed / (SIGN_SHARE * speed.std() + 1e-300))
        pairs.append(
            (np.column_stack([t.pressure_a[:, j], t.pressure_b[:, j], friction, speed, change]), t.effort[:, j])
        )
    dt = trials[0].dt
    whole = skew(pairs, dt, min_drop=LEAST_DROP)
    parts = []
    for x, y in pairs:
        for piece in np.array_split(np.arange(len(y)), max(1, MIN_BLOCKS // len(pairs))):
            lag = skew([(x[piece], y[piece])], dt, min_drop=LEAST_DROP)
            parts.append(0.0 if lag is None else lag)
    error = float(np.std(parts, ddof=1) / np.sqrt(len(parts)))
    value, margin = whole or 0.0, max(NORMAL * error, LEAST_SHARE * dt)
    sure = abs(value) > SIGMAS * error and whole is not None
    return CrossCheck(
        "channel_skew", joint, value, "s", value - margin, value + margin, bool(sure), "the chamber pressures"
    )
