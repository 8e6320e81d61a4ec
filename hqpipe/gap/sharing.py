"""What joints share: a set that explains several is the simpler story, and many faint signs make a clear one.

Joints are searched one by one; then groups are asked together, because an effect that every joint shows a little
may be clear in their sum, and an effect that most joints show is looked for in the rest with less suspicion.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from hqpipe.gap.changes import CANDIDATES, compared_by_kind, in_order
from hqpipe.gap.estimate import agree, estimates
from hqpipe.gap.groups import groups
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import MATERIAL, RIVAL_Z, WORTH
from hqpipe.gap.set_fit import SetFit

POOLED_SHARE = 0.75  # of a group's joints that must show an effect
POOLED_RATIO, POOLED_Z = 1.01, 1.0  # what counts as showing it, in a group
WORTH_POOLED = 1.07  # mean of that ratio where no joint of the group has shown it by itself
MOST_OF, LIKE = 0.5, 0.5  # share of a group from which the rest is asked kindly; how near its parameter must come
KIND_RATIO, KIND_Z = 1.003, 0.5  # what counts as showing it then
CONSENSUS, MOST_SETS = 1.02, 4  # error ratio that a shared set may cost a joint; sets that are tried
SPLIT = 1.5
"""The same for a set that is no larger, where only the held-out trials are against it or the torque's sign had to be restored;
assumption."""


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
                state = state.choose(state.search.fit((names - {support.effect}) | {best}, [state.chosen]))
        found.append(state)
    return found


def _shared_sets(states: list[JointState]) -> list[JointState]:
    """Whole sets exchanged for more common ones; a joint that has more than a set has it too."""
    sets = [frozenset(state.chosen.effects) for state in states]
    rare = rare_names(states)
    sharers = {names: sum(names <= others for others in sets) for names in sets}
    common = sorted(sharers, key=lambda names: (-sharers[names], -len(names), in_order(names)))
    found = []
    for state, own in zip(states, sets, strict=True):
        against = {names: sum(own <= others and not names <= others for others in sets) for names in common}
        made_up = _made_up(state, states, rare)
        wider = [names for names in common if sharers[names] > against[names] and _other(names, state, made_up)]
        for names in wider[:MOST_SETS]:
            fit = _as_sharers(state, state.search.fit(names, [state.chosen]), states)
            if _as_good(state, fit):
                state = state.choose(fit)
                break
        found.append(state)
    return found


def rare_names(states: list[JointState]) -> set[str]:
    """Effects that fewer than `MOST_OF` of the joints have."""
    holders = Counter(name for state in states for name in state.chosen.effects)
    return {name for name, count in holders.items() if count < MOST_OF * len(states)}


def _other(names: frozenset[str], state: JointState, made_up: set[str]) -> bool:
    """Whether a set is no part of the joint's own, which the search has weighed, or lacks only what may be made up."""
    own = set(state.chosen.effects)
    return names <= set(state.search.library) and (not names <= own or (names != own and own - names <= made_up))


def _made_up(state: JointState, states: list[JointState], rare: set[str]) -> set[str]:
    """Rare names that a restored sign may have made up: those that its groups do not share."""
    if not state.data.barred:
        return set()
    found = set(state.chosen.effects) & rare
    for members in groups(tuple(other.joint for other in states)):
        if state.joint in members:
            inside = [other for other in states if other.joint in members]
            holders = Counter(name for other in inside for name in other.chosen.effects)
            found -= {name for name, count in holders.items() if count >= POOLED_SHARE * len(inside)}
    return found


def _as_good(state: JointState, fit: SetFit) -> bool:
    """Whether a more common set explains a joint about as well as its own."""
    own = state.chosen
    ratio, z = state.search.gain(fit, own)
    split = fit.loss < own.loss or bool(state.data.barred)  # a restored sign errs as no effect does
    split = split and len(fit.effects) <= len(own.effects) and ratio <= SPLIT
    return (ratio <= CONSENSUS or (z < RIVAL_Z and ratio <= WORTH) or split) and _all_earn(state, fit)


def _as_sharers(state: JointState, fit: SetFit, states: list[JointState]) -> SetFit:
    """The set with limits that this joint's fit trials do not reach where the joints that chose the set have them."""
    sharers = [s for s in states if set(fit.effects) <= set(s.chosen.effects)]
    for name in fit.effects:
        alike = [s for s in sharers if s.data.linear == state.data.linear or not compared_by_kind(name)]
        if CANDIDATES[name].parameters[0].inverse and alike:
            value = float(np.median([s.first_number(name) for s in alike]))
            fit = state.search.as_others(fit, name, value)
    return fit


def _all_earn(state: JointState, fit: SetFit) -> bool:
    """Whether every effect of a set does something in a joint, if less than a name of its own would need."""
    gains = [state.search.gain(state.search.without(fit, name), fit) for name in fit.effects]
    return all(ratio > POOLED_RATIO and z > POOLED_Z for ratio, z in gains)


def pool_groups(states: list[JointState]) -> list[JointState]:
    """Ask the machine, then its groups, for effects that single joints show too weakly; and all once more for those that
    were added, because a group that was asked late may have made one common in another."""
    pooled = _asked_together(states, None)
    added = {
        name for old, new in zip(states, pooled, strict=True) for name in {*new.chosen.effects} - {*old.chosen.effects}
    }
    return _asked_together(pooled, added) if added else pooled


def _asked_together(states: list[JointState], names: set[str] | None) -> list[JointState]:
    """The joints after their groups were asked, for some effects or for all."""
    joints, states = tuple(state.joint for state in states), list(states)
    if len(joints) < 2:
        return states
    for members in (joints, *groups(joints)):
        inside = [i for i, name in enumerate(joints) if name in members]
        for effect in dict.fromkeys(name for i in inside for name in states[i].search.library):
            if names is not None and effect not in names:
                continue
            able = [i for i in inside if effect in states[i].search.library]
            for asked in _of_one_unit(effect, able, states):
                for i, state in zip(asked, _shared(effect, [states[i] for i in asked]) or [], strict=False):
                    states[i] = state
    return states


def _of_one_unit(effect: str, asked: list[int], states: list[JointState]) -> list[list[int]]:
    """The joints in parts in which the numbers of an effect can be compared: those that turn, and those that slide."""
    if not compared_by_kind(effect):
        return [asked]
    parts = [[i for i in asked if states[i].data.linear == linear] for linear in (False, True)]
    return [part for part in parts if part]


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
    first = CANDIDATES[effect].parameters[0].name
    if not all(first in p for p in parts) or not agree([p[first] for p in parts], tolerance=0.5):
        return None
    return [m.choose(fits[m.joint]) if m in showing else m for m in members]


def _joined(
    effect: str,
    members: list[JointState],
    already: list[JointState],
    fits: dict[str, SetFit],
) -> list[JointState]:
    """The group with an effect that most of it has added in those that show it faintly, at a like size.

    What belongs to the machine by nature is added in all.
    """
    first = CANDIDATES[effect].parameters[0].name
    known = [p[first].value for m in already if first in (p := estimates(m.data, m.chosen, effect))]
    if not known:
        return members
    middle, changed = float(np.median(known)), []
    inner = float(np.median([m.first_number(effect) for m in already]))
    for m in members:
        if m.joint in fits and not CANDIDATES[effect].machine:
            fits[m.joint] = m.search.as_others(m.chosen, effect, inner)
            ratio, z = m.search.gain(m.chosen, fits[m.joint])
            value = estimates(m.data, fits[m.joint], effect).get(first)
            like = value is not None and abs(value.value - middle) <= LIKE * abs(middle)
            shows = ratio >= KIND_RATIO and z >= KIND_Z and like
        else:
            shows = m.joint in fits
        changed.append(m.choose(fits[m.joint]) if shows else m)
    return changed


def _promising(effect: str, members: list[JointState]) -> bool:
    """Whether the effect alone helps most joints at all, on the fit trials."""
    helps = sum(m.search.fit((effect,)).loss < 0.995 * m.base.loss for m in members)
    return helps >= POOLED_SHARE * len(members)
