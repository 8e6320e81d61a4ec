"""What a table of parameters gives once and for all: which links of the chain it has, and columns that follow from it."""

from __future__ import annotations

from typing import Final

import numpy as np

from hqpipe.machine.loops.augmented_columns import (
    AREAS,
    ASYMMETRY,
    BAND,
    BEHIND,
    BIAS,
    COMPLIANCE,
    COULOMB,
    DELAY,
    DRIFT,
    DROOP,
    DT,
    GAP,
    K3,
    KI,
    LAG,
    LEAK_DRIFT,
    LOAD,
    ORIFICE,
    RECOVERY,
    SATURATION,
    SLOPE,
    SPRINGY,
    STATIC,
    UNEVEN,
    VALVE_DELAY,
    VISCOUS,
)
from hqpipe.machine.loops.augmented_command import piston_lag
from hqpipe.machine.loops.augmented_ring import RING_LENGTH
from hqpipe.machine.orifice_flow import balance
from hqpipe.machine.position_dependent_stiffness import lean, uneven
from hqpipe.machine.transmission_compliance import softened
from hqpipe.machine.valve_lag import lag_share, mean_share, swing

BLOCK: Final = 384  # joints (32 quadrupeds): measured; the columns in use of a block stay in the cache

# links that can be left out, and whether all joints are late by as many whole samples, in the command and in what is put out
(
    ALIKE,
    DELAYED,
    BIASED,
    INTEGRATED,
    LAGGED,
    DEAD,
    SATURATED,
    ONE_SIDED,
    DRIFTING,
    SAGGING,
    FLOWING,
    STIFFENED,
    SLACK,
    RUBBING,
    RELAXING,
    SENT_ALIKE,
    SENT_LATE,
    SWINGING,
    LEAKING,
) = range(19)
LINKS: Final = 19
# columns that follow from a row of parameters
(WHOLE, PART, SHARE, MEAN_SHARE, TOP, ONE_WAY, PER_S, RECOVERED, HALF, SOFT, LEAN, RELAXED, MEAN_RELAXED, EVEN) = range(
    14
)
SENT_WHOLE, SENT_PART = 14, 15
SWING: Final = 16  # the first of six
DERIVED: Final = 22


def prepare(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the compiled loops need of a table, repeated for as many robots as a block holds.

    Args:
        parameters: (J, WIDTH).

    Returns:
        (WIDTH, B) parameters, (DERIVED, B) what follows from them, (LINKS,) bool links that some joint has.
    """
    p = parameters.T
    lag, sent = (np.clip(p[column] / p[DT], 0.0, RING_LENGTH - 2.0) for column in (DELAY, VALVE_DELAY))
    derived = np.empty((DERIVED, len(parameters)))
    derived[WHOLE], derived[PART] = np.floor(lag), lag - np.floor(lag)
    derived[SENT_WHOLE], derived[SENT_PART] = np.floor(sent), sent - np.floor(sent)
    for j, row in enumerate(parameters):
        derived[SHARE, j], derived[MEAN_SHARE, j] = lag_share(row[LAG], row[DT]), mean_share(row[LAG], row[DT])
        derived[SWING : SWING + 6, j] = swing(row[LAG], row[SPRINGY], row[DT])
        behind = piston_lag(row)
        derived[RELAXED, j], derived[MEAN_RELAXED, j] = lag_share(behind, row[DT]), mean_share(behind, row[DT])
        derived[RECOVERED, j] = lag_share(row[RECOVERY], row[DT])
        derived[ONE_WAY, j] = row[ASYMMETRY] + uneven(row[SLOPE], row[UNEVEN])
        derived[LEAN, j] = lean(row[SLOPE])
        derived[EVEN, j] = balance(row[AREAS], row[ORIFICE])
        derived[SOFT, j] = softened(row[K3], row[COMPLIANCE], row[DT])
    derived[TOP] = 1.0 / np.maximum(p[SATURATION], 1e-300)
    derived[PER_S] = p[DRIFT] * p[DT]
    derived[HALF] = 0.5 * p[GAP] * p[K3] / p[DT]
    links = np.zeros(LINKS, dtype=np.bool_)
    signs = {
        DELAYED: (DELAY,),
        BIASED: (BIAS,),
        INTEGRATED: (KI,),
        LAGGED: (LAG,),
        SWINGING: (SPRINGY,),
        LEAKING: (LEAK_DRIFT,),
        DEAD: (BAND,),
        SATURATED: (SATURATION,),
        ONE_SIDED: (ASYMMETRY, UNEVEN),
        DRIFTING: (DRIFT,),
        SAGGING: (DROOP,),
        FLOWING: (ORIFICE, DROOP),
        STIFFENED: (SLOPE,),
        SLACK: (GAP,),
        RUBBING: (COULOMB, STATIC, LOAD, VISCOUS),
        RELAXING: (BEHIND,),
        SENT_LATE: (VALVE_DELAY,),
    }
    for link, columns in signs.items():
        links[link] = np.any(p[list(columns)] != 0.0)
    links[ALIKE] = np.all(derived[WHOLE] == derived[WHOLE, 0])
    links[SENT_ALIKE] = np.all(derived[SENT_WHOLE] == derived[SENT_WHOLE, 0])
    robots = max(1, BLOCK // len(parameters))
    return np.tile(p, robots), np.tile(derived, robots), links
