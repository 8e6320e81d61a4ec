"""How soft the link between piston and joint is, as the travel says in which friction turns round.

The law has the stiffness of oil and link in series, K = k3/Δt, so that no torque tells how much of it is the link's. Friction
does, where the torque is measured behind it: while the piston sticks, the torque changes by −K_t Δq, with the stiffness K_t of
the link alone, until the friction F has turned round. The travel for that is F/K_t.

A rod or a chain has at most `MOST_BEHIND` of the compliance, so that K_t is at least K / MOST_BEHIND. A softer one is
`transmission_compliance`. With it the lag of the piston beside viscous friction follows, too.
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.model import Samples
from hqpipe.layers.actuator.parameters import OF_FRICTION
from hqpipe.machine.layout import slot
from hqpipe.machine.viscous_friction import MOST_BEHIND

COMPLIANCE = ("transmission_compliance", "stiffness_nm_per_rad")
LAG = ("viscous_friction", "behind_piston")
_TURN = [slot(owner, p.name) for owner, p in OF_FRICTION]
_K3, _STEP = slot("base", "k3"), slot("setting", "sample_time")
_HELD = [slot("coulomb_friction", "friction_nm"), slot("stribeck_friction", "static_nm")]
_BY_LOAD, _DAMPING, _LAG = (
    slot("load_dependent_friction", "coefficient"),
    slot("viscous_friction", "nm_s_per_rad"),
    slot(*LAG),
)
_ROUNDING = 1e-9


def load_at_reversals(samples: Samples) -> float:
    """Root mean square of the torque where the speed changes its sign, as friction turns round there; of all samples where it
    never does."""
    turns = np.flatnonzero((samples.velocity[1:] * samples.velocity[:-1] < 0.0) & (np.diff(samples.trial) == 0))
    return float(np.sqrt(np.mean((samples.output[turns] if len(turns) else samples.output) ** 2)))


def let_turn(row: np.ndarray, load: float, compliance: float, is_limited: bool) -> None:
    """Let friction turn round within the travel that a soft link gives it, in place.

    Args:
        row: (WIDTH,) of the loops, see `hqpipe.machine.layout`. load: of `load_at_reversals`. compliance: of the link,
            rad/(N·m); 0 where the travel is what was fitted. is_limited: whether that is no more than a rod or a chain gives
            it.
    """
    held, drive = _held(row, load), stiffness(row)
    if held <= 0.0 or drive <= 0.0:
        return
    if compliance <= 0.0 and is_limited:
        row[_TURN] = np.minimum(row[_TURN], MOST_BEHIND * held / drive)
    if compliance > 0.0:
        row[_TURN] = compliance * held
        if row[_DAMPING] != 0.0:
            row[_LAG] = min(compliance * drive, 1.0)


def compliance_of(row: np.ndarray, load: float) -> float:
    """Of a link that is softer than a rod or a chain, rad/(N·m), as a row of the loops has it; 0 for none, or where the row
    does not say it."""
    held, drive, turn = _held(row, load), stiffness(row), float(row[_TURN[0]])
    if not held > 0.0 or not drive > 0.0 or not turn > MOST_BEHIND * held / drive * (1.0 + _ROUNDING):
        return 0.0
    return turn / held


def _held(row: np.ndarray, load: float) -> float:
    """Most that friction holds, N·m."""
    return float(row[_HELD].sum() + row[_BY_LOAD] * load)


def stiffness(row: np.ndarray) -> float:
    """Of oil and link in series, N·m/rad."""
    return float(row[_K3] / row[_STEP])
