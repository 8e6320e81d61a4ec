"""Offsets behind an integrator: what it held when the trials began tells them, if all joints' integrators began alike.

An integrator takes up a constant offset of its joint, so that the run of a trial says nothing of it. Its start does: one that
was switched on empty, while the joint was held, has wound up by what the error was then, and the rest of what it seems to
hold is the offset. When it was switched on is not in the logs, but it is one time for the whole machine, and most joints
have to agree on it. Where they do not, a start tells nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hqpipe.effects.integral_action import wound_up_for
from hqpipe.effects.layout import NOT_KNOWN, slot
from hqpipe.gap.joint_data import Split
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import WORTH, JointSearch
from hqpipe.gap.set_fit import ITERATIONS, JointFitter, SetFit
from hqpipe.gap.sharing import CONSENSUS
from hqpipe.kernels.augmented_windows import integrator_starts

INTEGRATOR, OFFSETS = "integral_action", ("torque_bias", "position_bias")
LEAST_JOINTS = 3  # that agree; two cannot tell a time and an offset from chance
AGREED = 0.6  # share of the joints with an integrator that must agree; a third of them may have an offset; assumption
STILL_WINDING = (
    0.2  # error over what is held, both at the start: an integrator that has settled leaves no error; assumption
)
TIMES = np.concatenate([[0.0], np.geomspace(0.01, 100.0, 400)])  # s, for which the joints may have been held
HELD = slot("setting", "held")


@dataclass(frozen=True, eq=False)
class Start:
    """One joint's integrator when its trials began, all trials that are there from their start.

    Attributes:
        held: (T,) what it seems to hold, in the unit of the command; error: (T,) of the position then, rad.
        ki: 1/s. inverse_limit: one over its limit. torque: RMS over a window of the torque that one more rad of opening makes,
            N·m/rad. slight: N·m, an offset that is not worth a name. linear: whether the joint is prismatic, in m and N.
    """

    held: np.ndarray
    error: np.ndarray
    ki: float
    inverse_limit: float
    torque: float
    slight: float
    linear: bool = False

    @property
    def weight(self) -> float:
        """1/rad: what an offset counts beside those of other joints, which may be in other units."""
        return self.torque / max(self.slight, 1e-300)

    def offset(self, time: float) -> np.ndarray:
        """(T,) rad that it holds beyond what it can have wound up in `time` s."""
        return self.held - [wound_up_for(error, self.ki, self.inverse_limit, time) for error in self.error]

    def agrees(self, offset: np.ndarray, other: float) -> bool:
        """Whether offsets (T,) differ from another by no more than is worth a name."""
        return bool(np.all(np.abs(offset - other) * self.torque < self.slight))


def tell_offsets(states: list[JointState], workers: int = 1) -> list[JointState]:
    """The joints with the offsets that their integrators' starts show.

    Args:
        states: position mode; others are returned as they are, as are those beside an earlier record, whose integrators may
            have begun otherwise.
        workers: joints fitted at a time; the result does not depend on their number.
    """
    if states[0].data.mode != "position" or any(state.data.then is not None for state in states):
        return states
    members = [i for i, state in enumerate(states) if INTEGRATOR in state.chosen.effects]
    starts = {i: _start(states[i]) for i in members}
    time = time_held(list(starts.values()))
    if time is None:
        return states
    asked = [i for i in members if _has_offset(states[i], starts[i], time)]
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        offered = dict(zip(asked, pool.map(partial(_offers, time=time), [states[i] for i in asked]), strict=True))
    offered = {i: found for i, found in offered.items() if found}
    common = [name for name in OFFSETS if all(name in found for found in offered.values())]
    if not offered or not common:
        return states
    best = min(common, key=lambda name: sum(np.log(found[name].chosen.loss) for found in offered.values()))
    return [offered[i][best] if i in offered else state for i, state in enumerate(states)]


def time_held(starts: Sequence[Start]) -> float | None:
    """For how long the joints were held before the trials began, s, by the least sum of absolute offsets, each over what is
    not worth a name, or of their differences where most joints have one; None where they do not agree, or have settled."""
    if len(starts) < LEAST_JOINTS:
        return None
    held, errors = (sum(s.weight * np.abs(getattr(s, name)).sum() for s in starts) for name in ("held", "error"))
    if errors < STILL_WINDING * held:
        return None

    def none(_: float) -> dict[bool, float]:
        return {start.linear: 0.0 for start in starts}

    def common(time: float) -> dict[bool, float]:
        """By the kind of joint, for offsets in rad and in m have no common size."""
        alike = {start.linear: [s.offset(time) for s in starts if s.linear == start.linear] for start in starts}
        return {linear: float(np.median(np.concatenate(offsets))) for linear, offsets in alike.items()}

    def spread(time: float, middle: dict[bool, float]) -> float:
        return sum(s.weight * float(np.abs(s.offset(time) - middle[s.linear]).sum()) for s in starts)

    for centre in (none, common):  # where errors are alike, a longer time would pass for an offset that all have
        time = min(TIMES, key=lambda t: spread(t, centre(t)))
        middle = centre(time)
        agreed = sum(start.agrees(start.offset(time), middle[start.linear]) for start in starts)
        if agreed >= max(LEAST_JOINTS, AGREED * len(starts)):
            return float(time)
    return None


def _start(state: JointState) -> Start:
    row = state.chosen.row.copy()
    row[HELD] = NOT_KNOWN
    parts = [_in_trials(row, split) for split in (state.data.fit, state.data.heldout)]
    held, error = (np.concatenate(values) for values in zip(*parts, strict=True))
    ki, inverse_limit = row[[slot(INTEGRATOR, "ki"), slot(INTEGRATOR, "limit")]]
    left = (1.0 - row[slot("base", "k2")]) ** np.arange(state.data.fit.signals.steps)
    torque = float(row[slot("base", "k1")] * np.sqrt(np.mean(np.cumsum(left) ** 2)))
    slight = float(np.sqrt((WORTH - 1.0) * state.chosen.error))
    return Start(held, error, ki, inverse_limit, torque, slight, state.data.linear)


def _in_trials(row: np.ndarray, split: Split) -> tuple[np.ndarray, np.ndarray]:
    """What the integrator holds, and the error of the position, at the starts of trials; sections begin later."""
    first = split.signals.bounds[:-1]
    whole = split.signals.time[first] == 0.0
    error = split.signals.command[first] - split.signals.position[first]
    return integrator_starts(row, split.signals)[whole], error[whole]


def _has_offset(state: JointState, start: Start, time: float) -> bool:
    """Whether an offset is worth a name and the same in all trials, and the joint has none yet."""
    offset = start.offset(time)
    known = set(OFFSETS) & set(state.chosen.effects)
    return not known and not start.agrees(offset, 0.0) and start.agrees(offset, float(np.mean(offset)))


def _offers(state: JointState, time: float) -> dict[str, JointState]:
    """Offset → the joint with it and a start that is known, where that explains as much as one that is free."""
    search = _known_start(state, time)
    row = state.chosen.row.copy()
    row[HELD] = time
    warm = replace(state.chosen, row=row)
    less: SetFit = search.fit(state.chosen.effects, [warm], ITERATIONS)
    found = {}
    for name in (name for name in OFFSETS if name in search.library):
        fit = search.fit((*state.chosen.effects, name), [warm], ITERATIONS)
        earned = search.earns(fit, search.support(name, less, fit))
        if earned and fit.error <= CONSENSUS * state.chosen.error:
            found[name] = JointState(search, state.base, fit, search.with_support(fit), state.dropped)
    return found


def _known_start(state: JointState, time: float) -> JointSearch:
    row = state.data.row.copy()
    row[HELD] = time
    return JointSearch(JointFitter(replace(state.data, row=row)), state.search.library, state.search.significance)
