"""The paper's model with the effects that a diagnosis found."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from hqpipe.actuators.base import ActuatorModel, ParameterField, end_to_end
from hqpipe.actuators.loops.actuator_step import AUGMENTED
from hqpipe.machine import EFFECTS
from hqpipe.machine.bases.hydraulic import HYDRAULIC
from hqpipe.machine.chain import loops
from hqpipe.machine.layout import FIELDS, neutral_row
from hqpipe.machine.moment_arm import PARAMETERS as ARM

_SETTINGS = {
    "sample_time": "s",
    "middle": "rad",
    "clear": "N·m",
    "effort_limit": "N·m",
    "flow_per_speed": "1",
    "flow_per_opening": "1/s",
    "speed_late": "samples",
    "held": "s",
    **ARM,
}
_ANY = 1e12  # bound of numbers that may have either sign
OF_THE_LOG = tuple(name for name, effect in EFFECTS.items() if effect.of_the_log)


def _name(owner: str, name: str) -> str:
    return name if owner in ("base", "setting") else f"{owner}_{name}"


def _field(owner: str, name: str) -> ParameterField:
    """Range and unit; a parameter that is kept as its inverse or its square has the unit of that."""
    if owner == "base":
        return ParameterField(HYDRAULIC.parameters[name], lower=0.0)
    if owner == "setting":
        lower = -_ANY if name in ("middle", "speed_late", "held", *ARM) else 0.0
        limit = name == "effort_limit"
        return ParameterField(_SETTINGS[name], lower, may_be_infinite=limit, certain=name not in ARM)
    effect = EFFECTS[owner]
    parameter = next(p for p in effect.parameters if p.name == name)
    unit = "rad" if parameter.unit == "command" else parameter.unit
    if parameter.inverse or parameter.squared:
        unit = f"{'1/' if parameter.inverse else ''}({unit}){'²' if parameter.squared else ''}"
    return ParameterField(unit, lower=-_ANY if parameter.search.lower < 0.0 else 0.0, shared=effect.machine)


class Augmented(ActuatorModel):
    """Eq. (7) in joint space with every effect of `hqpipe.machine`, neutral where it was not found.

    The chain is that of `hqpipe.machine.chain`. Columns are those of `hqpipe.machine.layout`:
    limits and stiffnesses are kept as their inverse, so that 0 means "absent".
    """

    NAME = "augmented"
    KIND = AUGMENTED
    DT_BOUND = True
    MEMORY = loops().memory
    FIELDS: ClassVar[dict[str, ParameterField]] = {_name(*key): _field(*key) for key in FIELDS}

    @property
    def effects(self) -> dict[str, tuple[str, ...]]:
        """Effect → joints in which it is active."""
        neutral = neutral_row()
        found = {}
        for name in EFFECTS:
            telling = [parameter.name for parameter in EFFECTS[name].parameters if parameter.search.counts]
            columns = [i for i, (owner, column) in enumerate(FIELDS) if owner == name and column in telling]
            if columns:
                active = np.any(self.parameters[:, columns] != neutral[columns], axis=1)
                found[name] = tuple(joint for joint, on in zip(self.joints, active, strict=True) if on)
        return {name: joints for name, joints in found.items() if joints}

    def fresh_memory(self, count: int) -> np.ndarray:
        """As that of every model; each of the M numbers lies side by side for all joints, as the fast way needs it."""
        return np.zeros((self.MEMORY, count, len(self.joints))).transpose(1, 2, 0)

    @cached_property
    def _prepared(self) -> tuple[np.ndarray, ...]:
        return loops().prepare(self.parameters)

    def _advance(self, tau: np.ndarray, memory: np.ndarray, q_des: np.ndarray, q: np.ndarray, qd: np.ndarray) -> None:
        planes = memory.transpose(2, 0, 1)
        flat = end_to_end(tau, q_des, q, qd)
        if flat and planes.flags.c_contiguous:
            first, *others = flat
            loops().step_batch(*self._prepared, first, planes.reshape(self.MEMORY, -1), *others, len(self.joints))
        else:
            super()._advance(tau, memory, q_des, q, qd)
