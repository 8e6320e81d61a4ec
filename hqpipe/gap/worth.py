"""Which names are worth keeping: those that close a joint's gap, are a fault at all, and matter to it or to the machine.

A joint whose best set leaves most of what could be explained is not given a name at all: an effect that is not in
the library makes several of those that are look useful.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hqpipe.gap.causes import Cause
from hqpipe.gap.changes import CANDIDATES, columns
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.rest import Rest

LEAST_CLOSURE = 0.8  # of the squared error above the noise floor; assumption, between right and wrong names
REST = 1.12  # squared error over the noise floor that is no gap worth a name, whatever share of it is left; assumption
HALF, NEAR_REST, FAR_REST = 0.5, 1.4, 2.0
"""Closure that is enough where no more than `NEAR_REST` times the floor is left; from `FAR_REST` on `LEAST_CLOSURE` is asked,
and between them in proportion. Assumptions: what a library lacks leaves more than sticking and slipping do."""
FEW = 2  # effects of a joint that are believed where more than HALF of the machine's gap stays open; assumption
TRIFLE, NEEDED, NEEDED_Z = 0.025, 1.1, 2.5
"""Share of the gap; squared error of a joint without the effect over that with it, and how sure that must be. Assumptions."""
OUTWEIGHED = 1.2
"""Fall of the squared error over the predictable rest. In cases looked into it is above 1.3 for right names, mostly above 20,
and below 1.2 for 12 of 13 names of effects that were not there, beside one that was left out of the library."""
MOST_OF_IT = 0.85
"""The same over all of the rest above the noise, from which on nothing is asked: a small right effect beside a large one whose
formula is coarse does not reach the former. In cases looked into 0.92 to 1.2 for such, at most 0.81 for wrong names."""
SLIGHT = "too small to be a fault"  # why a name is not there


def close_gap(states: list[JointState], floor: np.ndarray) -> list[JointState]:
    """Give up the names in joints where they close too little of what is above the noise floor.

    Args:
        states: one per joint. floor: (J,) mean squared error that noise alone leaves.
    """
    found = []
    for state, noise in zip(states, floor, strict=True):
        share, left = state.closure(noise), state.chosen.error / noise
        asked = float(np.interp(left, (NEAR_REST, FAR_REST), (HALF, LEAST_CLOSURE)))
        if state.chosen.effects and share < asked and left > REST:
            reason = f"closes only {max(share, 0.0):.0%} of the squared error above the noise in {state.joint}"
            state = bare(state, reason)
        found.append(state)
    return _believed(found, floor)


def _believed(states: list[JointState], floor: np.ndarray) -> list[JointState]:
    """Without the large sets of a machine most of whose gap, each joint's against its scale, stays open: what the library
    lacks there is likely to act here too, and enough names imitate anything."""
    weight = np.array([s.data.scale for s in states]) ** -2.0
    before = float(weight @ [s.base.error for s in states])
    after = float(weight @ [s.chosen.error for s in states])
    noise = float(weight @ floor)
    if after <= REST * noise or before - after >= HALF * (before - noise):
        return states
    reason = f"more than {FEW} names in one joint of a machine whose gap stays open"
    return [bare(state, reason) if len(state.chosen.effects) > FEW else state for state in states]


def bare(state: JointState, reason: str) -> JointState:
    """The joint without names."""
    return JointState(state.search, state.base, state.base, (), dict.fromkeys(state.chosen.effects, reason))


def drop_slight(states: list[JointState], causes: Sequence[Cause]) -> list[JointState]:
    """Take back the names of effects so small that every machine has them."""
    found = {state.joint: state for state in states}
    for cause in causes:
        if all(_slight(cause.effect, found[joint]) for joint in cause.joints):
            take_back(cause, found, SLIGHT)
    return list(found.values())


def drop_trifles(
    states: list[JointState], causes: Sequence[Cause], shrink: np.ndarray, low: np.ndarray
) -> list[JointState]:
    """Take back names that shrink the machine's gap by next to nothing and that no joint needs, or that widen it.

    Args:
        causes: of the states. shrink, low: (C,) their shares and the lower ends of the intervals.
    """
    found = {state.joint: state for state in states}
    for cause, share, least in zip(causes, shrink, low, strict=True):
        members = [found[joint] for joint in cause.joints]
        if (least <= 0.0 or share < TRIFLE) and not _needed(cause, members):
            take_back(cause, found, f"shrinks the gap by {share:.1%} only")
    return list(found.values())


def drop_outweighed(
    states: list[JointState], causes: Sequence[Cause], sensor: np.ndarray, rest: Rest
) -> list[JointState]:
    """Take back names that explain hardly more than what could still be explained in their joints.

    Where something acts that the library lacks, names that resemble it a little are picked up beside those that are right.
    What cannot be predicted, as sticking and slipping, is held against no name. The weakest goes first and the others are
    weighed again without it, so that of two names for one thing the better stays; what it explained is part of the rest then.
    Joints count by their errors against their scales.

    Args:
        causes: of the states. sensor: (J,) mean squared error that the noise of the output's sensor leaves.
        rest: of the machine with the states' effects.
    """
    found = {state.joint: state for state in states}
    before = {s.joint: s.chosen.error for s in states}
    noise = {s.joint: float(level) for s, level in zip(states, sensor, strict=True)}
    weight = {s.joint: s.data.scale**-2.0 for s in states}

    def total(members: list[JointState], size: Callable[[JointState], float]) -> float:
        return sum(weight[s.joint] * size(s) for s in members)

    causes = list(causes)
    while causes:
        outweighed = []
        for cause in causes:
            members = _judges([found[joint] for joint in cause.joints])
            fall = total(members, lambda s, name=cause.effect: s.search.without(s.chosen, name).error - s.chosen.error)
            if fall >= MOST_OF_IT * total(members, lambda s: max(s.chosen.error - noise[s.joint], 0.0)):
                continue
            given_up = total(members, lambda s: s.chosen.error - before[s.joint])
            left = total(members, lambda s: _open_to_others(s, rest.predictable(s.joint) * before[s.joint]))
            bar = OUTWEIGHED * (given_up + left)
            if fall < bar:
                outweighed.append((fall / max(bar, 1e-300), cause))
        if not outweighed:
            break
        weakest = min(outweighed, key=lambda item: item[0])[1]
        take_back(weakest, found, "explains hardly more than what could still be explained in its joints")
        causes.remove(weakest)
    return list(found.values())


def _judges(members: list[JointState]) -> list[JointState]:
    """The joints in which a rest speaks against a name: not those whose torque's sign was restored, if there are others, since
    wrong signs leave a rest of their own."""
    return [state for state in members if not state.data.barred] or members


def _open_to_others(state: JointState, predictable: float) -> float:
    """What is left of a predictable rest beside what slight faults of the joint explain, which no unknown one has to."""
    slight = [name for name, reason in state.dropped.items() if reason == SLIGHT]
    if not slight:
        return predictable
    return max(
        predictable - (state.chosen.error - state.search.fit((*state.chosen.effects, *slight), [state.chosen]).error),
        0.0,
    )


def take_back(cause: Cause, states: dict[str, JointState], reason: str) -> None:
    """Drop a cause from the states of its joints, in place."""
    for joint in cause.joints:
        state = states[joint]
        fit = state.search.without(state.chosen, cause.effect)
        dropped = {**state.dropped, cause.effect: reason}
        states[joint] = JointState(state.search, state.base, fit, state.search.with_support(fit), dropped)


def _needed(cause: Cause, states: list[JointState]) -> bool:
    """Whether a joint would be clearly worse without the effect."""
    supports = [s for state in states for s in state.support if s.effect == cause.effect]
    return any(s.ratio >= NEEDED and s.z >= NEEDED_Z for s in supports)


def _slight(effect: str, state: JointState) -> bool:
    """Whether the effect is smaller than what its file calls worth a name."""
    least = CANDIDATES[effect].parameters[0].least
    if not least or (state.data.then is not None and effect in state.data.then.effects):
        return False
    largest = float(np.abs(state.data.fit.signals.effort).max())
    return bool(abs(state.chosen.row[columns(effect)[0]]) * largest < least)
