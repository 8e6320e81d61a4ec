"""Overlap of the spool: commands within ± half_width open nothing; worn or rounded lands soften the corner."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import COMMAND, NONE, Block, Effect, Parameter, Search

SHARP = 1e-300  # half width of a corner that has none


@njit(cache=True, nogil=True, inline="always")
def beyond(excess: float, corner: float, bend: float) -> float:
    """max(excess, 0) with a parabola of half width `corner` round the corner, bent by `bend` = 1/(4 corner); branch-free."""
    inside = min(max(excess + corner, 0.0), 2.0 * corner)
    return bend * inside * inside + max(excess - corner, 0.0)


@njit(cache=True, nogil=True, inline="always")
def deadband(opening: float, half_width: float, rounding: float) -> float:
    """What is left of an opening beyond ± half_width; `rounding` is the corner's half width as a share of that, squared."""
    corner = np.sqrt(rounding) * half_width
    bend = 0.25 / max(corner, SHARP)
    return beyond(opening - half_width, corner, bend) - beyond(-opening - half_width, corner, bend)


EFFECT = Effect(
    name="valve_deadband",
    layer="actuator",
    parameters=(
        Parameter("half_width", "command", Search(COMMAND, 0.0, 3.0, (0.05, 0.3, 0.8))),
        Parameter("rounding", "1", Search(NONE, 0.0, 2.25, (0.1,), counts=False), squared=True),
    ),
    meaning="commands smaller than the valve's overlap do nothing",
    source="Merritt, Hydraulic Control Systems, 1967: overlapped valve centre",
    experiment="slow motion of small amplitude, so that the command dwells around zero",
    advice="Compensate the lap in the valve driver: step across ± the half width when the command changes sign, "
    "blended so that it does not chatter; then record again.",
    blocks=(Block(deadband, ("opening", "half_width", "rounding"), ("opening",), ("half_width",)),),
)
