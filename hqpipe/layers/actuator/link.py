"""How soft the link between piston and joint is, as the travel says in which friction turns round.

The law has the stiffness of oil and link in series, K = k3/Δt, so that no torque tells how much of it is the link's. Friction
does, where the torque is measured behind it: while the piston sticks, the torque changes by −K_t Δq, with the stiffness K_t of
the link alone, until the friction F has turned round. The travel for that is F/K_t, and the link has the share K/K_t of the
compliance. A rod or a chain has at most `MOST_BEHIND` of it; all of it would leave no oil.
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.model import Samples
from hqpipe.layers.actuator.parameters import OF_FRICTION
from hqpipe.machine.layout import slot
from hqpipe.machine.viscous_friction import MOST_BEHIND

_TURN = [slot(owner, p.name) for owner, p in OF_FRICTION]
_K3, _STEP = slot("base", "k3"), slot("setting", "sample_time")
_HELD = [slot("coulomb_friction", "friction_nm"), slot("stribeck_friction", "static_nm")]
_BY_LOAD = slot("load_dependent_friction", "coefficient")


def load_at_reversals(samples: Samples) -> float:
    """Root mean square of the torque where the speed changes its sign, as friction turns round there; of all samples where it
    never does."""
    turns = np.flatnonzero((samples.velocity[1:] * samples.velocity[:-1] < 0.0) & (np.diff(samples.trial) == 0))
    return float(np.sqrt(np.mean((samples.output[turns] if len(turns) else samples.output) ** 2)))


def compliance(row: np.ndarray, load: float) -> tuple[float, float] | None:
    """Of the link, rad/(N·m), and its share of that of oil and link in series; None without friction.

    Args:
        row: (WIDTH,) of the loops, see `hqpipe.machine.layout`. load: of `load_at_reversals`.
    """
    held, stiffness = _held(row, load), _stiffness(row)
    if held <= 0.0 or stiffness <= 0.0:
        return None
    found = float(row[_TURN[0]]) / held
    return found, found * stiffness


def stiffen(row: np.ndarray, load: float) -> None:
    """Let friction turn round within the travel that a rod or a chain gives it at most, in place; arguments as of
    `compliance`."""
    held, stiffness = _held(row, load), _stiffness(row)
    if held > 0.0 and stiffness > 0.0:
        row[_TURN] = np.minimum(row[_TURN], MOST_BEHIND * held / stiffness)


def _held(row: np.ndarray, load: float) -> float:
    """Most that friction holds, N·m."""
    return float(row[_HELD].sum() + row[_BY_LOAD] * load)


def _stiffness(row: np.ndarray) -> float:
    """Of oil and link in series, N·m/rad."""
    return float(row[_K3] / row[_STEP])
