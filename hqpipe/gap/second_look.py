"""A second look at each joint, with what the others found.

Where a fit begins decides where it ends, so that a name may stand in for a better fit of the others: these are fitted once
more from the numbers that other joints have. A joint that was given a name by the others has not been asked what shows
beside it. And what belongs to the machine by nature has one size: a joint that bends it hides something else in it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from hqpipe.effects.layout import slots
from hqpipe.gap.changes import CANDIDATES, compared_by_kind
from hqpipe.gap.estimate import estimates
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import JointSearch
from hqpipe.gap.set_fit import JointFitter, SetFit
from hqpipe.gap.sharing import MOST_OF, rare_names

LEAST_SHARERS = 3  # joints with a size, so that one of them can be the odd one
ODD = 0.25  # of the middle: a size that differs by less, or whose interval holds it, is the machine's; as `agree`


def look_again(searched: list[JointState], shared: list[JointState], workers: int = 1) -> list[JointState]:
    """The joints after the second look.

    Args:
        searched: each by itself. shared: after they were asked together; returned as they are beside an earlier record, where
            nothing but changes is fitted.
        workers: joints looked at at a time; the result does not depend on their number.
    """
    if any(state.data.then is not None for state in shared):
        return shared
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        sized = _one_size(shared, pool)
        rare = rare_names(sized)
        less = list(pool.map(lambda state: _needs_less(state, sized, rare), sized))
        return list(pool.map(_completed, searched, less))


def _completed(alone: JointState, state: JointState) -> JointState:
    """With what shows beside the names that the others gave the joint; a restored sign errs as no effect does."""
    if state.chosen.effects == alone.chosen.effects or state.data.barred:
        return state
    return state.choose(state.search.completed(state.chosen, kept=state.chosen.effects))


def _one_size(states: list[JointState], pool: ThreadPoolExecutor) -> list[JointState]:
    """Joints with another size of what belongs to the machine are searched again with the machine's, if that leaves less."""
    for effect in dict.fromkeys(name for state in states for name in state.chosen.effects):
        members = [s for s in states if effect in s.chosen.effects]
        if CANDIDATES[effect].machine and len(members) >= max(LEAST_SHARERS, MOST_OF * len(states)):
            middle = np.median([s.chosen.row[slots(effect)] for s in members], axis=0)
            held = dict(zip(slots(effect), middle.tolist(), strict=True))
            odd = [i for i, s in enumerate(states) if s in members and _odd(s, effect, middle[0])]
            again = pool.map(partial(_searched_with, effect=effect, held=held), [states[i] for i in odd])
            found = dict(zip(odd, again, strict=True))
            states = [found.get(i, s) for i, s in enumerate(states)]
    return states


def _odd(state: JointState, effect: str, middle: float) -> bool:
    """Whether a joint's first number of an effect is clearly not that of the others."""
    first = CANDIDATES[effect].parameters[0]
    part = estimates(state.data, state.chosen, effect).get(first.name)
    if part is None:
        return False
    usual = 1.0 / middle if first.inverse else middle
    return abs(part.value - usual) > ODD * abs(usual) and not part.low <= usual <= part.high


def _searched_with(state: JointState, effect: str, held: dict[int, float]) -> JointState:
    search = JointSearch(JointFitter(replace(state.data, held=held)), state.search.library, state.search.significance)
    found = search.run()
    if effect not in found.best.effects or found.best.error >= state.chosen.error:
        return state
    return JointState(search, found.base, found.best, found.support, state.dropped)


def _needs_less(state: JointState, states: list[JointState], rare: set[str]) -> JointState:
    """Without the rare names that are needed no more once the others are fitted from where other joints have them."""
    others, search = [s.chosen for s in states if s is not state], state.search
    kind = [s.chosen for s in states if s is not state and s.data.linear == state.data.linear]
    for name in (name for name in state.chosen.effects if name in rare):
        less = search.without(state.chosen, name)
        numbers = _numbers(less.effects, kind if any(map(compared_by_kind, less.effects)) else others)
        if numbers and _earns(search, state.chosen, less, name):
            better = search.like(less, numbers)
            if better is not less and not _earns(search, state.chosen, better, name):
                return _needs_less(state.choose(better), states, rare)
    return state


def _earns(search: JointSearch, fit: SetFit, less: SetFit, name: str) -> bool:
    return search.earns(fit, search.support(name, less, fit))


def _numbers(names: tuple[str, ...], others: list[SetFit]) -> dict[int, float]:
    """Column → median of other joints' numbers; empty where one of the effects is in no other joint."""
    found: dict[int, float] = {}
    for name in names:
        rows = [fit.row[slots(name)] for fit in others if name in fit.effects]
        if not rows:
            return {}
        found |= zip(slots(name), np.median(rows, axis=0).tolist(), strict=True)
    return found
