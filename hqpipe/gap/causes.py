"""From the searches of single joints to the causes of a machine.

Joints are searched one by one; then groups are asked together, because an effect that every joint shows a little
may be clear in their sum, and an effect that most joints show is looked for in the rest with less suspicion. A
joint whose best set leaves most of what could be explained is not given a name at all: an effect that is not in
the library makes several of those that are look useful.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import norm

from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import slots
from hqpipe.errors import UsageError, near_match
from hqpipe.gap.estimate import Estimate, agree, estimates, pooled, stated
from hqpipe.gap.groups import groups, scope_of
from hqpipe.gap.joint_data import JointData
from hqpipe.gap.search import MATERIAL, RIVAL_Z, WORTH, JointResult, JointSearch, Support
from hqpipe.gap.set_fit import JointFitter, SetFit

SIGNIFICANCE = 0.05  # that any effect at all is named on logs without one
LEAST_CLOSURE = 0.8  # of the squared error above the noise floor; assumption, between right and wrong names
REST = 1.12  # squared error over the noise floor that is no gap worth a name, whatever share of it is left; assumption
HALF, NEAR_REST, FAR_REST = 0.5, 1.4, 2.0
"""Closure that is enough where no more than `NEAR_REST` times the floor is left; from `FAR_REST` on `LEAST_CLOSURE` is asked,
and between them in proportion. Assumptions: what a library lacks leaves more than sticking and slipping do."""
POOLED_SHARE = 0.75  # of a group's joints that must show an effect
POOLED_RATIO, POOLED_Z = 1.01, 1.0  # what counts as showing it, in a group
WORTH_POOLED = 1.07  # mean of that ratio where no joint of the group has shown it by itself
MOST_OF, LIKE = 0.5, 0.5  # share of a group from which the rest is asked kindly; how near its parameter must come
KIND_RATIO, KIND_Z = 1.003, 0.5  # what counts as showing it then
TRIFLE, NEEDED, NEEDED_Z = 0.025, 1.1, 2.5
"""Share of the gap; squared error of a joint without the effect over that with it, and how sure that must be. Assumptions."""
CONSENSUS, MOST_SETS = 1.02, 4  # error ratio that a shared set may cost a joint; sets that are tried
Progress = Callable[[float, float, str], None]


@dataclass(frozen=True, eq=False)
class JointState:
    """Where the diagnosis of a joint stands.

    Attributes:
        search: its search. base, chosen: fits without and with effects.
        support: of the chosen effects. dropped: effect → why it was not accepted.
    """

    search: JointSearch
    base: SetFit
    chosen: SetFit
    support: tuple[Support, ...]
    dropped: dict[str, str] = field(default_factory=dict)

    @property
    def joint(self) -> str:
        return self.search.fitter.data.joint

    @property
    def data(self) -> JointData:
        return self.search.fitter.data


@dataclass(frozen=True, eq=False)
class Cause:
    """An accepted effect: where, how sure, how large, and what it could be taken for."""

    effect: str
    joints: tuple[str, ...]
    scope: str
    probability: float
    parameters: dict[str, Estimate]
    rivals: tuple[str, ...]


def library(
    mode: str, effort_source: str | None, joints: int, without: Sequence[str] = (), effort: bool = True
) -> tuple[str, ...]:
    """Effects that logs of this kind can show; `effort`: whether the torque was recorded.

    Raises:
        UsageError: `without` names an effect that does not exist.
    """
    for name in without:
        if name not in EFFECTS:
            raise UsageError(f"without: no effect '{name}'{near_match(name, EFFECTS)} (known: {', '.join(EFFECTS)})")
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if mode in effect.modes
        and effect.parameters
        and joints >= effect.least_joints
        and (effort or not effect.needs_effort)
        and (effect.effort_sources is None or effort_source in effect.effort_sources)
        and name not in without
    )


def search_joints(
    data: Sequence[JointData], names: Sequence[str], workers: int = 1, progress: Progress | None = None
) -> list[JointState]:
    """Search every joint, `workers` at a time; the result does not depend on their number."""
    questions = max(len(data) * len(names), 1)
    significance = float(norm.isf(SIGNIFICANCE / questions))
    searches = [JointSearch(JointFitter(d), [n for n in names if n not in d.barred], significance) for d in data]

    def one(search: JointSearch) -> JointResult:
        return search.run()

    states = []
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        for done, (search, result) in enumerate(zip(searches, pool.map(one, searches), strict=True), start=1):
            states.append(JointState(search, result.base, result.best, result.support))
            if progress:
                progress(done, len(searches), f"{result.joint}: {result.tried} sets of effects fitted")
    return states


def seek_consensus(states: list[JointState]) -> list[JointState]:
    """Of several sets that explain a joint alike, give it the one that more of the machine has.

    A cause that the joints share is the simpler story. First single effects are exchanged for rivals that more
    joints name, then whole sets are tried.
    """
    return _shared_sets(_shared_rivals(states))


def _shared_rivals(states: list[JointState]) -> list[JointState]:
    popular = Counter(name for state in states for name in state.chosen.effects)
    found = []
    for state in states:
        for support in state.support:
            better = [name for name in support.rivals if popular[name] > popular[support.effect]]
            names = set(state.chosen.effects)
            if better and support.effect in names:
                best = max(better, key=lambda name: popular[name])
                state = _with(state, state.search.fit((names - {support.effect}) | {best}, [state.chosen]))
        found.append(state)
    return found


def _shared_sets(states: list[JointState]) -> list[JointState]:
    popular = Counter(state.chosen.effects for state in states)
    found = []
    for state in states:
        better = state.chosen
        for names, count in popular.most_common(MOST_SETS):
            if count > popular[better.effects] and set(names) <= set(state.search.library):
                fit = _as_sharers(state, state.search.fit(names, [state.chosen]), states)
                ratio, z = state.search.gain(fit, state.chosen)
                if (ratio <= CONSENSUS or (z < RIVAL_Z and ratio <= WORTH)) and _all_earn(state, fit):
                    better = fit
                    break
        found.append(_with(state, better))
    return found


def _as_sharers(state: JointState, fit: SetFit, states: list[JointState]) -> SetFit:
    """The set with limits that this joint's fit trials do not reach where the joints that chose the set have them."""
    sharers = [s.chosen.row for s in states if s.chosen.effects == fit.effects]
    for name in fit.effects:
        if EFFECTS[name].parameters[0].inverse:
            value = float(np.median([row[slots(name)[0]] for row in sharers]))
            fit = state.search.as_others(fit, name, value)
    return fit


def _with(state: JointState, fit: SetFit) -> JointState:
    """The joint with another set chosen."""
    if fit is state.chosen:
        return state
    return JointState(state.search, state.base, fit, state.search.with_support(fit), state.dropped)


def drop_trifles(
    states: list[JointState], causes: Sequence[Cause], shrink: np.ndarray, low: np.ndarray
) -> list[JointState]:
    """Take back names that shrink the machine's gap by next to nothing and that no joint needs.

    Args:
        causes: of the states. shrink, low: (C,) their shares and the lower ends of the intervals.
    """
    found = {state.joint: state for state in states}
    for cause, share, least in zip(causes, shrink, low, strict=True):
        members = [found[joint] for joint in cause.joints]
        if least > 0.0 and share >= TRIFLE:
            continue
        if not _needed(cause, members):
            _take_back(cause, found, f"shrinks the gap by {share:.1%} only")
    return list(found.values())


def drop_slight(states: list[JointState], causes: Sequence[Cause]) -> list[JointState]:
    """Take back the names of effects so small that every machine has them."""
    found = {state.joint: state for state in states}
    for cause in causes:
        if all(_slight(cause.effect, found[joint]) for joint in cause.joints):
            _take_back(cause, found, "too small to be a fault")
    return list(found.values())


def _take_back(cause: Cause, states: dict[str, JointState], reason: str) -> None:
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
    largest = float(np.abs(state.data.fit.signals.effort).max())
    return bool(abs(state.chosen.row[slots(effect)[0]]) * largest < EFFECTS[effect].parameters[0].least)


def _all_earn(state: JointState, fit: SetFit) -> bool:
    """Whether every effect of a set does something in a joint, if less than a name of its own would need."""
    gains = [state.search.gain(state.search.without(fit, name), fit) for name in fit.effects]
    return all(ratio > POOLED_RATIO and z > POOLED_Z for ratio, z in gains)


def pool_groups(states: list[JointState]) -> list[JointState]:
    """Ask the machine, then its groups, for effects that single joints show too weakly."""
    joints = tuple(state.joint for state in states)
    if len(joints) < 2:
        return states
    for members in (joints, *groups(joints)):
        inside = [i for i, name in enumerate(joints) if name in members]
        for effect in dict.fromkeys(name for i in inside for name in states[i].search.library):
            asked = [i for i in inside if effect in states[i].search.library]
            for i, state in zip(asked, _shared(effect, [states[i] for i in asked]) or [], strict=False):
                states[i] = state
    return states


def _shared(effect: str, members: list[JointState]) -> list[JointState] | None:
    """The group with an effect added where it was lacking, if the group shows it."""
    lacking = [m for m in members if effect not in m.chosen.effects]
    if not lacking or (len(lacking) == len(members) and not _promising(effect, members)):
        return None
    if len(members) < 2:
        return None
    fits = {m.joint: m.search.fit((*m.chosen.effects, effect), [m.chosen]) for m in lacking}
    gains = {m.joint: m.search.gain(m.chosen, fits[m.joint]) for m in lacking}
    showing = [m for m in lacking if gains[m.joint][0] >= POOLED_RATIO and gains[m.joint][1] >= POOLED_Z]
    already = [m for m in members if m not in lacking]
    if len(already) >= MOST_OF * len(members):
        return _joined(effect, members, already, fits)
    if len(members) - len(lacking) + len(showing) < POOLED_SHARE * len(members) or not showing:
        return None
    z = sum(gains[m.joint][1] for m in showing) / np.sqrt(len(showing))
    fall = np.mean([(m.chosen.error - fits[m.joint].error) / (MATERIAL * m.data.output) ** 2 for m in showing])
    ratio = np.mean([gains[m.joint][0] for m in showing])
    if z < members[0].search.significance or (not already and (fall < 1.0 or ratio < WORTH_POOLED)):
        return None
    parts = [estimates(m.data, fits[m.joint], effect) for m in showing]
    parts += [estimates(m.data, m.chosen, effect) for m in already]
    first = EFFECTS[effect].parameters[0].name
    if not all(first in p for p in parts) or not agree([p[first] for p in parts], tolerance=0.5):
        return None
    return [_with(m, fits[m.joint]) if m in showing else m for m in members]


def _joined(
    effect: str,
    members: list[JointState],
    already: list[JointState],
    fits: dict[str, SetFit],
) -> list[JointState]:
    """The group with an effect that most of it has added in those that show it faintly, at a like size.

    What belongs to the machine by nature is added in all.
    """
    first = EFFECTS[effect].parameters[0].name
    known = [p[first].value for m in already if first in (p := estimates(m.data, m.chosen, effect))]
    if not known:
        return members
    middle, changed = float(np.median(known)), []
    column = slots(effect)[0]
    inner = float(np.median([m.chosen.row[column] for m in already]))
    for m in members:
        if m.joint in fits and not EFFECTS[effect].machine:
            fits[m.joint] = m.search.as_others(m.chosen, effect, inner)
            ratio, z = m.search.gain(m.chosen, fits[m.joint])
            value = estimates(m.data, fits[m.joint], effect).get(first)
            like = value is not None and abs(value.value - middle) <= LIKE * abs(middle)
            shows = ratio >= KIND_RATIO and z >= KIND_Z and like
        else:
            shows = m.joint in fits
        changed.append(_with(m, fits[m.joint]) if shows else m)
    return changed


def _promising(effect: str, members: list[JointState]) -> bool:
    """Whether the effect alone helps most joints at all, on the fit trials."""
    helps = sum(m.search.fit((effect,)).loss < 0.995 * m.base.loss for m in members)
    return helps >= POOLED_SHARE * len(members)


def close_gap(states: list[JointState], floor: np.ndarray) -> list[JointState]:
    """Give up the names in joints where they close too little of what is above the noise floor.

    Args:
        states: one per joint. floor: (J,) mean squared error that noise alone leaves.
    """
    found = []
    for state, noise in zip(states, floor, strict=True):
        share, left = closure(state, noise), state.chosen.error / noise
        asked = float(np.interp(left, (NEAR_REST, FAR_REST), (HALF, LEAST_CLOSURE)))
        if state.chosen.effects and share < asked and left > REST:
            reason = f"closes only {max(share, 0.0):.0%} of the squared error above the noise in {state.joint}"
            state = JointState(state.search, state.base, state.base, (), dict.fromkeys(state.chosen.effects, reason))
        found.append(state)
    return found


def closure(state: JointState, floor: float) -> float:
    """Share of the squared held-out error above the noise floor that the chosen set removes."""
    before = state.base.error - floor
    return (state.base.error - state.chosen.error) / before if before > 0 else 0.0


def assemble(states: list[JointState], floor: np.ndarray, machine: Sequence[str] = ()) -> list[Cause]:
    """Merge the joints' effects into causes: one per set of joints that could share its parameters.

    Args:
        states: one per joint. floor: (J,) of these joints. machine: all joints, if these are only some.
    """
    joints = tuple(machine) or tuple(state.joint for state in states)
    floors = {state.joint: float(level) for state, level in zip(states, floor, strict=True)}
    causes = []
    for effect in dict.fromkeys(name for state in states for name in state.chosen.effects):
        members = [s for s in states if effect in s.chosen.effects]
        parts = {s.joint: estimates(s.data, s.chosen, effect) for s in members}
        for batch in [members] if EFFECTS[effect].machine else _alike(effect, members, parts):
            causes.append(_cause(effect, batch, parts, joints, floors))
    return causes


def _alike(effect: str, members: list[JointState], parts: dict[str, dict[str, Estimate]]) -> list[list[JointState]]:
    """Joints whose first parameter agrees, in batches; the largest batch first."""
    first = EFFECTS[effect].parameters[0].name
    rest, batches = sorted(members, key=lambda s: parts[s.joint][first].value if first in parts[s.joint] else 0.0), []
    while rest:
        best: list[JointState] = []
        for centre in rest:
            batch = [s for s in rest if _near(parts[centre.joint].get(first), parts[s.joint].get(first))]
            best = batch if len(batch) > len(best) else best
        best = best or rest[:1]
        batches.append(best)
        rest = [s for s in rest if s not in best]
    order = [s.joint for s in members]
    return [sorted(batch, key=lambda s: order.index(s.joint)) for batch in batches]


def _near(a: Estimate | None, b: Estimate | None) -> bool:
    return a is not None and b is not None and agree([a, b])


def _cause(
    effect: str,
    members: list[JointState],
    parts: dict[str, dict[str, Estimate]],
    joints: tuple[str, ...],
    floor: dict[str, float],
) -> Cause:
    names = tuple(s.joint for s in members)
    parameters = {}
    for parameter in EFFECTS[effect].parameters:
        known = [parts[name][parameter.name] for name in names if parameter.name in parts[name]]
        if len(known) == len(names):
            one = pooled(known) if len(known) > 1 else known[0]
            parameters[parameter.name] = stated(one, parameter.unit, members[0].data.row_dt)
    supports = [next(x for x in s.support if x.effect == effect) for s in members]
    rivals = [set(x.rivals) for x in supports]
    common = set.intersection(*rivals) if rivals else set()
    odds = [_log_odds(x, closure(s, floor[s.joint]), len(common)) for x, s in zip(supports, members, strict=True)]
    probability = float(1.0 / (1.0 + np.exp(-max(odds))))
    scope = "machine" if EFFECTS[effect].machine else scope_of(names, joints)
    ordered = tuple(name for name in EFFECTS if name in common)
    return Cause(effect, names, scope, probability, parameters, ordered)


def _log_odds(support: Support, closed: float, rivals: int) -> float:
    """Log odds that the name is right; see docs/theory/diagnosis.md for where the weights come from."""
    return -1.0 + 0.8 * float(np.log(max(support.ratio - 1.0, 1e-3))) + 4.0 * min(max(closed, 0.0), 1.0) - 0.7 * rivals
