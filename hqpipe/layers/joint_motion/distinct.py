"""Which effects these logs can tell from the base, and from each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hqpipe.identify.model import Effect
from hqpipe.layers.joint_motion.candidates import DIRECT, SHAPES
from hqpipe.layers.joint_motion.columns import Columns
from hqpipe.layers.joint_motion.coupling import Nuisance
from hqpipe.layers.joint_motion.first_fit import least_squares
from hqpipe.layers.joint_motion.records import Part

ALIKE = 0.98  # correlation, given the base, above which two effects are one: each would have its own standard error five-fold
LEFT = 0.02  # of the size of a column that must be left given the base; assumption: below it the filter's error decides
WAYS = 0.05  # of the moving samples that must lie in each direction; assumption: with less, one way decides by itself
LOAD, FRICTION = "load_dependent_friction", ("coulomb_friction", "viscous_friction")
GROUPS = {name: group for name, (_, _, group) in DIRECT.items()} | {
    "stribeck_friction": "stribeck",
    "velocity_shape": "velocity",
    "position_shape": "position",
    "direction_asymmetry": "speed",
}


@dataclass(frozen=True)
class Distinguished:
    """Effects that these logs can tell from the base.

    Attributes:
        effects: those that mean the same exclude each other. same: effect → others that do the same in these logs and are not
            among `effects`. notes: sentences that say so.
    """

    effects: tuple[Effect, ...]
    same: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...]


def both_ways(part: Part, columns: Columns) -> bool:
    """Whether the joint moves in both directions."""
    direction = part.columns[part.keep, columns.one("coulomb")]
    return min(np.mean(direction > 0.5), np.mean(direction < -0.5)) > WAYS


def distinguished(
    effects: tuple[Effect, ...], part: Part, columns: Columns, base: np.ndarray, nuisance: Nuisance
) -> Distinguished:
    """The effects that differ from the base.

    Args:
        base: indices of the columns of the base. nuisance: what the other joints may do.
    """
    rows = part.columns[part.keep]
    sizes, rows = _size(rows), nuisance.left(rows)
    own, notes, gone = {}, [], set()
    for effect in effects:
        if effect.name in GROUPS:
            column = rows[:, columns[GROUPS[effect.name]]]
            left = column - rows[:, base] @ np.column_stack([least_squares(rows[:, base], c) for c in column.T])
            if np.max(_size(left) / np.maximum(sizes[list(columns[GROUPS[effect.name]])], 1e-300)) < LEFT:
                gone.add(effect.name)
                if effect.named:
                    notes.append(
                        f"{effect.name} cannot be told from inertia, gravity and a constant torque in these logs"
                    )
            else:
                own[effect.name] = left
    same = {}
    if LOAD in own:
        same = {name: (LOAD,) for name in FRICTION if name in own and _alike(own[LOAD], own[name])}
    if same:
        del own[LOAD]
        gone.add(LOAD)
        notes.append(f"{LOAD} cannot be told from dry and viscous friction in these logs: the load hardly varies")
    excludes = {effect.name: set(effect.excludes) for effect in effects}
    for a, b in combinations(own, 2):
        if _alike(own[a], own[b]):
            excludes[a].add(b)
            excludes[b].add(a)
            if a not in SHAPES and b not in SHAPES:
                notes.append(f"{a} and {b} cannot be told apart: the joint moves at one speed only, or nearly so")
    kept = tuple(replace(e, excludes=frozenset(excludes[e.name])) for e in effects if e.name not in gone)
    return Distinguished(kept, same, tuple(notes))


def _size(columns: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(columns**2, axis=0))


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether all of the narrower group lies along the other, one column against one."""
    if a.shape[1] > 1 or b.shape[1] > 1:
        a, b = (a, b) if a.shape[1] <= b.shape[1] else (b, a)
        return a.shape[1] == 1 and all(_alike(a, b[:, [k]]) for k in range(b.shape[1]))
    return abs(float(a[:, 0] @ b[:, 0])) > ALIKE * float(np.linalg.norm(a) * np.linalg.norm(b))
