"""From what joints were found to have to the causes of a machine: which joints share one, how sure, and how large."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hqpipe.effects.effect import Parameter
from hqpipe.gap.changes import ALIKE, CANDIDATES, FACTORS, RATIO, columns, compared_by_kind
from hqpipe.gap.estimate import Estimate, agree, estimates, pooled, stated
from hqpipe.gap.groups import scope_of
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import Support

MOST = 0.5  # share of a cause's joints that must not tell a rival from it; assumption


@dataclass(frozen=True, eq=False)
class Cause:
    """An accepted effect: where, how sure, how large, and what it could be taken for.

    Attributes:
        then: parameter → its value in an earlier record, None where the effect was absent; empty without such a record.
    """

    effect: str
    joints: tuple[str, ...]
    scope: str
    probability: float
    parameters: dict[str, Estimate]
    rivals: tuple[str, ...]
    then: dict[str, float | None] = field(default_factory=dict)


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
        for batch in [members] if CANDIDATES[effect].machine else _alike(effect, members, parts):
            causes.append(_cause(effect, batch, parts, joints, floors))
    return causes


def _alike(effect: str, members: list[JointState], parts: dict[str, dict[str, Estimate]]) -> list[list[JointState]]:
    """Joints whose first parameter agrees, in batches of one unit; the largest batch first."""
    if compared_by_kind(effect) and len({s.data.linear for s in members}) > 1:
        kinds = [[s for s in members if s.data.linear == linear] for linear in (False, True)]
        return sorted((batch for kind in kinds for batch in _alike(effect, kind, parts)), key=len, reverse=True)
    first = CANDIDATES[effect].parameters[0].name
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
    for column, parameter in zip(columns(effect), CANDIDATES[effect].parameters, strict=True):
        own = [s.joint for s in members if column not in s.data.held]
        known = [parts[name][parameter.name] for name in own if parameter.name in parts[name]]
        if known and len(known) == len(own):
            one = pooled(known) if len(known) > 1 else known[0]
            parameters[parameter.name] = stated(one, parameter, members[0].data.row_dt)
    supports = [next(x for x in s.support if x.effect == effect) for s in members]
    counted = Counter(name for x in supports for name in x.rivals)
    common = {name for name, count in counted.items() if count > MOST * len(supports)}
    odds = [_log_odds(x, s.closure(floor[s.joint]), len(common)) for x, s in zip(supports, members, strict=True)]
    probability = float(1.0 / (1.0 + np.exp(-max(odds))))
    scope = "machine" if CANDIDATES[effect].machine else scope_of(names, joints)
    ordered = tuple(name for name in CANDIDATES if name in common)
    if effect in ALIKE and RATIO in parameters and parameters[RATIO].value < 1.0:
        ordered = (*ordered, *(name for name in ALIKE[effect] if name not in ordered))
    then = {p.name: _then(effect, p, members) for p in CANDIDATES[effect].parameters if p.name in parameters}
    return Cause(effect, names, scope, probability, parameters, ordered, then if _compared(effect, members) else {})


def _compared(effect: str, members: list[JointState]) -> bool:
    return effect not in FACTORS and members[0].data.then is not None


def _then(effect: str, parameter: Parameter, members: list[JointState]) -> float | None:
    """Mean over the joints of what a parameter was in the earlier record; None where a joint lacked the effect."""
    if not _compared(effect, members) or any(effect not in s.data.then.effects for s in members):
        return None
    at = columns(effect)[[p.name for p in CANDIDATES[effect].parameters].index(parameter.name)]
    values = np.array([s.data.then.row[at] for s in members])
    if parameter.inverse and not values.all():
        return None
    return float(np.mean([parameter.told(value) for value in values]))


def _log_odds(support: Support, closed: float, rivals: int) -> float:
    """Log odds that the name is right; see docs/theory/diagnosis.md for where the weights come from."""
    return -1.0 + 0.8 * float(np.log(max(support.ratio - 1.0, 1e-3))) + 4.0 * min(max(closed, 0.0), 1.0) - 0.7 * rivals
