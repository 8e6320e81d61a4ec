"""A valve that is open round its centre, by underlapped lands or by rounded edges and clearance.

Where both lands of a port are open, the flow grows faster with the command, and oil leaks from one side to the other past the
centre. Sharp lands that underlap double the gain within ± half_width; rounded edges of a critical centre only leak.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import COMMAND, NONE, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def uncovered(shift: float, corner: float) -> float:
    """What a land uncovers that is sharp but for a corner of size √`corner`: (x + √(x² + corner))/2."""
    return 0.5 * (shift + np.sqrt(shift * shift + corner))


@njit(cache=True, nogil=True, inline="always")
def lands(opening: float, half_width: float, softness: float) -> tuple[float, float]:
    """What the two lands of a port open together, and what the one that closes still is open.

    Args:
        half_width: by how much each is open at the centre. softness: 0 for sharp lands that underlap by it, 1 for rounded
            edges of a critical centre.
    """
    underlap, corner = half_width * (1.0 - softness), 4.0 * softness * half_width * half_width
    one, other = uncovered(underlap + opening, corner), uncovered(underlap - opening, corner)
    return one - other, min(one, other)


@njit(cache=True, nogil=True, inline="always")
def seeped(leak: float, still_open: float, gain: float, inverse_limit: float) -> float:
    """Leakage in a sample with what passes the centre; in a sample no more leaks than there is.

    The land that closes passes w √(1 + τ/τ_max) where the one that opens loses w √(1 − τ/τ_max), w being what the first still
    is open: a difference of w τ/τ_max.

    Args:
        gain: of the base, N·m per opening and sample. inverse_limit: 1/τ_max of the orifices, 0 where the load bends no flow.
    """
    return min(leak + gain * still_open * inverse_limit, 1.0)


EFFECT = Effect(
    name="valve_underlap",
    layer="actuator",
    parameters=(
        Parameter("half_width", "command", Search(COMMAND, 0.0, 3.0, (0.05, 0.3, 0.8))),
        Parameter("softness", "1", Search(NONE, 0.0, 1.0, (0.1, 1.0), counts=False)),
    ),
    meaning="the valve is open round its centre, where it leaks and its gain is up to twice as large",
    source="Merritt, Hydraulic Control Systems, 1967: open-centre valves, centre flow of underlapped spools and of clearance",
    experiment="slow motion of small amplitude at several loads, so that the command dwells around zero",
    advice="Lower the gain within the underlap in the valve driver and simulate the leakage; where it has grown, edges of the "
    "spool are worn.",
    blocks=(
        Block(lands, ("opening", "half_width", "softness"), ("opening", "still_open"), ("half_width",)),
        Block(seeped, ("leak", "still_open", "gain", "orifice_flow.effort_max_nm"), ("leak",), ("half_width",)),
    ),
    excludes=("valve_deadband",),
)
