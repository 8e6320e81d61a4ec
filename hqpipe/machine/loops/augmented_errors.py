"""Errors of an augmented actuator in windows of a log, and what a change of each of its numbers makes necessary."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine import EFFECTS, effect
from hqpipe.machine.layout import FIELDS
from hqpipe.machine.loops.augmented_columns import ALL, COMMAND, CORE, FOLLOW, SLIDE, SUPPLY
from hqpipe.machine.loops.augmented_signals import Signals, Work, make_work
from hqpipe.machine.loops.augmented_windows import simulate

_DRIVEN = COMMAND | FOLLOW
_INPUTS = {
    effect.CORE: CORE,
    effect.FRICTION: FOLLOW,
    effect.SLIDING: SLIDE | FOLLOW,
    effect.COMMAND_SIDE: _DRIVEN,
    effect.SUPPLY: SUPPLY | _DRIVEN,
    effect.ALL_INPUTS: ALL,
}
_BY_STAGE = {"clock": _DRIVEN, "command": _DRIVEN, "core": CORE, "output": CORE}


def _inputs(owner: str, name: str) -> int:
    if owner not in EFFECTS:
        return CORE
    anew = next(p.anew for p in EFFECTS[owner].parameters if p.name == name)
    return _INPUTS[anew] if anew else _BY_STAGE[EFFECTS[owner].stage]


CHANGES = np.array([_inputs(*field) for field in FIELDS])
"""(WIDTH,) what a change of each column makes necessary, see `simulate`."""


@njit(cache=True, nogil=True)
def residual_windows(p: np.ndarray, s: Signals) -> np.ndarray:
    """(steps, W) predicted − logged output of every window; 0 where the target is NaN."""
    out = np.empty((s.steps, s.first.shape[0]))
    errors_of_windows(p, s, make_work(s), out, ALL)
    return out


@njit(cache=True, nogil=True)
def errors_of_windows(p: np.ndarray, s: Signals, work: Work, out: np.ndarray, inputs: int) -> None:
    """Fill `out` (steps, W) with what `residual_windows` gives; inputs: see `simulate`."""
    simulate(p, s, work, out, inputs)
    for k in range(out.shape[0]):
        for w in range(out.shape[1]):
            out[k, w] = 0.0 if np.isnan(s.target[k + 1, w]) else out[k, w] - s.target[k + 1, w]
