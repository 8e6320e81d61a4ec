"""Effects that act for a part of each trial only: a filter that clogs, a valve that warms, a cable that slips.

Where no set of effects explains a joint over whole trials, each trial is cut into one stretch with large errors and
the rest. If the base model, fitted to the rest, is nearly right there, the stretch is searched by itself, for effects alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hqpipe.gap.causes import assemble
from hqpipe.gap.joint_data import JointData, Split, Then
from hqpipe.gap.joint_state import JointState, search_joints
from hqpipe.gap.set_fit import JointFitter, SetFit, window_errors
from hqpipe.gap.sharing import pool_groups, seek_consensus
from hqpipe.gap.unchanged import drop_unchanged
from hqpipe.gap.worth import close_gap, drop_slight
from hqpipe.kernels.augmented_signals import Signals

LEAST_INSIDE, LEAST_OUTSIDE = 5, 0.3  # windows, share of a trial's windows; assumption
QUIET = 0.15  # excess outside over excess inside, above the floor, at which the rest counts as sound
TROUBLED = 1.15  # squared error over the floor of a joint that is worth the question
ROUNDS = 3  # of cutting and fitting the rest again


@dataclass(frozen=True, eq=False)
class Spans:
    """What was found inside the stretches.

    Attributes:
        states: one per joint that the stretches explain, fitted inside them.
        outside: joint → base fit outside; its error arrays run over all windows.
        fit, heldout: True for the windows of the machine inside.
        judged: joint → its held-out windows.
        stretches: (held-out trial, start s, end s); in the time of the recorded trial, where that was cut into sections.
    """

    states: list[JointState]
    outside: dict[str, SetFit]
    fit: np.ndarray
    heldout: np.ndarray
    judged: dict[str, Split]
    stretches: tuple[tuple[int, float, float], ...]

    def errors(self, joint: str, inside: np.ndarray) -> np.ndarray:
        """(W,) held-out errors of a joint: those given inside, the sound base model's outside."""
        errors = self.outside[joint].heldout.copy()
        errors[self.heldout[self.judged[joint].window]] = inside
        return errors


def search_spans(states: list[JointState], floor: np.ndarray, workers: int = 1) -> Spans | None:
    """Look for stretches of time in the joints that have a gap and no cause.

    Args:
        states: one per joint, after `close_gap`. floor: (J,) mean squared error that noise alone leaves.
    """
    troubled = [i for i, s in enumerate(states) if not s.chosen.effects and s.base.error > TROUBLED * floor[i]]
    if not troubled:
        return None
    asked = [i for i, s in enumerate(states) if not s.chosen.effects]
    data, level = [states[i].data for i in asked], floor[asked]
    telling = [asked.index(i) for i in troubled]
    rows = [states[i].base.row for i in asked]
    for _ in range(ROUNDS):
        shown = [data[k] for k in telling], [rows[k] for k in telling], level[telling]
        inside = [_cut(*shown, split) for split in ("fit", "heldout")]
        if any(mask is None or mask.all() for mask in inside):
            return None
        rest = [JointFitter(restrict(d, ~inside[0], ~inside[1])).fit() for d in data]
        rows = [fit.row for fit in rest]
    fit, heldout = inside
    outside = {
        d.joint: replace(r, heldout=window_errors(r.row, d.heldout), fitted=window_errors(r.row, d.fit))
        for d, r in zip(data, rest, strict=True)
    }
    quiet = [i for i, d in enumerate(data) if _is_quiet(outside[d.joint].heldout, heldout[d.heldout.window], level[i])]
    if not quiet:
        return None
    stretch = [_held(restrict(data[i], fit, heldout), outside[data[i].joint].row) for i in quiet]
    names = tuple(dict.fromkeys(name for state in states for name in state.search.library))
    found = search_joints(stretch, names, workers)
    found = close_gap(pool_groups(seek_consensus(found)), level[quiet])
    if data[0].then is not None:
        found = drop_unchanged(found, level[quiet])
    found = drop_slight(found, assemble(found, level[quiet]))
    found = [state for state in found if state.chosen.effects]
    if not found:
        return None
    judged = {d.joint: d.heldout for d in data}
    return Spans(found, outside, fit, heldout, judged, _stretches(data[0].heldout, heldout, data[0]))


def _held(inside: JointData, row: np.ndarray) -> JointData:
    """The joint in the stretches with all but their effects held at what it is outside: it is one machine, and a stretch
    alone is short enough for other coefficients to take much of an effect up."""
    then = inside.then or Then(row, np.empty(0, dtype=np.int64), np.empty((0, 0)))
    return replace(inside, then=then)


def restrict(data: JointData, fit: np.ndarray, heldout: np.ndarray) -> JointData:
    """The joint with only the windows that are True in masks of the machine's."""
    parts = [split.only(mask[split.window]) for split, mask in ((data.fit, fit), (data.heldout, heldout))]
    return replace(data, fit=parts[0], heldout=parts[1])


def _cut(data: list[JointData], rows: list[np.ndarray], floor: np.ndarray, name: str) -> np.ndarray | None:
    """True inside the stretches of a split, of the machine's windows; None if a trial shows none."""
    splits = [getattr(d, name) for d in data]
    heights, judged = np.zeros(len(splits[0].machine_trial)), np.zeros(len(splits[0].machine_trial))
    for row, split, level in zip(rows, splits, floor, strict=True):
        heights[split.window] += np.log(np.maximum(window_errors(row, split), 1e-300) / level)
        judged[split.window] += 1.0
    height, trial = heights / np.maximum(judged, 1.0), splits[0].machine_trial
    inside = np.zeros(len(height), dtype=bool)
    for index in np.unique(trial):
        at = np.flatnonzero(trial == index)
        bounds = _stretch(height[at])
        if bounds is None:
            return None
        inside[at[bounds[0] : bounds[1]]] = True
    return inside


def _stretch(height: np.ndarray) -> tuple[int, int] | None:
    """First and last window (exclusive) of the stretch that stands out most from the rest of a trial."""
    count = len(height)
    most = int((1.0 - LEAST_OUTSIDE) * count)
    if most < LEAST_INSIDE:
        return None
    sums = np.concatenate([[0.0], np.cumsum(height)])
    first, last = np.meshgrid(np.arange(count), np.arange(1, count + 1), indexing="ij")
    size = last - first
    allowed = (size >= LEAST_INSIDE) & (size <= most)
    total = sums[last] - sums[first]
    with np.errstate(divide="ignore", invalid="ignore"):
        contrast = (total / size - (sums[-1] - total) / (count - size)) * np.sqrt(size * (count - size) / count)
    contrast = np.where(allowed, contrast, -np.inf)
    best = np.unravel_index(int(np.argmax(contrast)), contrast.shape)
    return int(first[best]), int(last[best])


def _is_quiet(errors: np.ndarray, inside: np.ndarray, floor: float) -> bool:
    """Whether nearly all of the error above the floor lies inside."""
    return float(errors[~inside].mean()) - floor <= QUIET * (float(errors[inside].mean()) - floor)


def _stretches(split: Split, inside: np.ndarray, data: JointData) -> tuple[tuple[int, float, float], ...]:
    found, s = [], split.signals
    for index in np.unique(split.machine_trial):
        at = np.flatnonzero((split.machine_trial == index) & inside)
        start = _time_of(s, split.machine_first[at[0]], 0, data.row_dt)
        end = _time_of(s, split.machine_first[at[-1]], s.steps, data.row_dt)
        found.append((int(index), start, end))
    return tuple(found)


def _time_of(s: Signals, sample: int, later: int, dt: float) -> float:
    """s from the start of the recorded trial to `later` samples after `sample`."""
    offset = s.bounds[np.searchsorted(s.bounds, sample, side="right") - 1]
    return float(s.time[offset] + (sample + later - offset) * dt)
