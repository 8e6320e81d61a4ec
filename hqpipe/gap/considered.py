"""What `effects_considered` says of each candidate that no joint was given."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqpipe.gap.accuse import Accusation
from hqpipe.gap.changes import CANDIDATES, SCALE
from hqpipe.gap.groups import scope_of
from hqpipe.gap.joint_state import JointState
from hqpipe.logs.trajectory import LogSet

HELPS = 0.97  # of the loss in the fit trials that an effect must leave at most to count as seen there; assumption

_ABSORBED = "the base model's own coefficients take it up completely: these logs cannot show it"
_ABSORBED_SINCE = {
    "transmission_compliance": "it changes the coefficients as a softer oil does: see stiffness_change",
    SCALE: "left out of the library",
}
"""Beside a reference, whose coefficients stay as they are."""


def considered(found: Accusation, log_set: LogSet) -> list[dict[str, Any]]:
    """Candidates that were not accepted anywhere, the best first, with the reason."""
    accepted = {cause.effect for cause in found.causes}
    total = sum(state.of_machine(state.base).sum() / state.data.scale**2 for state in found.states)
    rows = []
    for effect in dict.fromkeys((*found.library, *_absorbed(log_set))):
        if effect in accepted:
            continue
        if effect not in found.library:
            compared = found.states[0].data.then is not None
            reason = _ABSORBED_SINCE[effect] if compared else _ABSORBED
            joints, score, shrink = list(log_set.joints), 0.0, 0.0
        else:
            joints, score, shrink = _alone(effect, found.states, total)
            reason = _reason(effect, found.states, score)
        rows.append(
            {
                "effect": effect,
                "layer": CANDIDATES[effect].layer,
                "joints": joints,
                "scope": scope_of(joints, log_set.joints),
                "score": significant(score),
                "shrink": significant(shrink),
                "reason": reason,
            }
        )
    return sorted(rows, key=lambda row: -row["shrink"])


def _absorbed(log_set: LogSet) -> list[str]:
    return [name for name, effect in CANDIDATES.items() if log_set.control_mode in effect.absorbed]


def _alone(effect: str, states: list[JointState], total: float) -> tuple[list[str], float, float]:
    """Joints that the effect alone would help, the largest z of its improvement, and its shrink."""
    after, best, joints = 0.0, 0.0, []
    for state in states:
        if effect not in state.search.library:
            after += state.of_machine(state.base).sum() / state.data.scale**2
            continue
        fit = state.search.fit((effect,))
        ratio, z = state.search.gain(state.base, fit)
        after += min(state.of_machine(f).sum() for f in (fit, state.base)) / state.data.scale**2
        if ratio > 1.05 and z > 2.0:
            joints.append(state.joint)
        best = max(best, z if ratio > 1.0 else 0.0)
    return joints, best, 1.0 - float(np.sqrt(after / total)) if total > 0 else 0.0


def _reason(effect: str, states: list[JointState], score: float) -> str:
    for state in states:
        if effect in state.dropped:
            return state.dropped[effect]
    if score < states[0].search.significance:
        return "does not lower the held-out error beyond chance"
    if all(
        state.search.fit((effect,)).loss > HELPS * state.base.loss for state in states if effect in state.search.library
    ):
        return "helps by chance: not in the fit trials"
    if any(state.chosen.effects for state in states):
        return "adds nothing once the accepted causes are in the model"
    return "lowers the held-out error too little to matter"


def significant(value: float) -> float:
    """Six significant digits, which is more than any log knows."""
    return float(f"{value:.6g}")
