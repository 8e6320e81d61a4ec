"""Where each number of an augmented actuator stands in its row of parameters.

A row holds the base model, then the parameters of every effect in the order of `EFFECTS`, neutral where the
effect is absent, then what the row was made for (sample time, middle position).
"""

from __future__ import annotations

import numpy as np

from hqpipe.machine import EFFECTS

BASE = ("k1", "k2", "k3", "k4")  # joint-space gains
SETTING = ("sample_time", "middle", "clear", "effort_limit", "flow_per_speed", "flow_per_opening", "speed_late", "held")
NOT_KNOWN = -1.0  # s: when the integrator was switched on before a trial began
NOT_IN_THE_LOOP = ("torque_scale", "unsigned_sensor")  # read off other channels, see hqpipe.gap

FIELDS: tuple[tuple[str, str], ...] = (
    *(("base", name) for name in BASE),
    *((e.name, p.name) for e in EFFECTS.values() if e.name not in NOT_IN_THE_LOOP for p in e.parameters),
    *(("setting", name) for name in SETTING),
)
WIDTH = len(FIELDS)


def slot(owner: str, name: str) -> int:
    """Column of one number."""
    return FIELDS.index((owner, name))


def slots(effect: str) -> list[int]:
    """Columns of an effect's parameters, in its own order."""
    return [i for i, (owner, _) in enumerate(FIELDS) if owner == effect]


def neutral_row() -> np.ndarray:
    """(WIDTH,) a row without any effect; base gains are zero, settings those of 1 kHz."""
    row = np.zeros(WIDTH)
    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            if effect.name not in NOT_IN_THE_LOOP:
                row[slot(effect.name, parameter.name)] = parameter.neutral
    row[slot("setting", "sample_time")] = 1e-3
    row[slot("setting", "clear")] = 1.0
    row[slot("setting", "effort_limit")] = np.inf
    row[slot("setting", "flow_per_speed")] = 1.0
    row[slot("setting", "held")] = NOT_KNOWN
    return row
