"""Where each number of an augmented actuator stands in its row of parameters.

A row holds the base model, then the parameters of every effect in the order of `EFFECTS`, neutral where the
effect is absent, then what the row was made for (sample time, middle position).
"""

from __future__ import annotations

import numpy as np

from hqpipe.machine import EFFECTS
from hqpipe.machine.bases.hydraulic import HYDRAULIC
from hqpipe.machine.compose.wiring import SETTING as SETTINGS
from hqpipe.machine.compose.wiring import Chain

WIRING = Chain(HYDRAULIC, EFFECTS.values())
BASE = tuple(HYDRAULIC.parameters)  # joint-space gains
SETTING = tuple(SETTINGS)
NOT_KNOWN = SETTINGS["held"]  # s: when the integrator was switched on before a trial began
FIELDS = WIRING.fields
WIDTH = len(FIELDS)


def slot(owner: str, name: str) -> int:
    """Column of one number."""
    return FIELDS.index((owner, name))


def slots(effect: str) -> list[int]:
    """Columns of an effect's parameters, in its own order."""
    return [i for i, (owner, _) in enumerate(FIELDS) if owner == effect]


def neutral_row() -> np.ndarray:
    """(WIDTH,) a row without any effect; base gains are zero, settings those of 1 kHz."""
    return WIRING.neutral_row()
