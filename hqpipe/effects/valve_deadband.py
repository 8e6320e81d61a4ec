"""Overlap of the spool: commands within ± half_width open nothing; worn or rounded lands soften the corner."""

from __future__ import annotations

from numba import njit

from hqpipe.effects.effect import COMMAND, NONE, Effect, Parameter

# Through the clearance of its lands a spool passes oil before it opens, so that the width is defined no better than
# that; Merritt's order of magnitude, and what withheld cases show.
CLEARANCE = 0.035  # of the width

EFFECT = Effect(
    name="valve_deadband",
    layer="actuator",
    stage="command",
    parameters=(
        Parameter("half_width", "command", COMMAND, 0.0, 3.0, (0.05, 0.3, 0.8), simplified=CLEARANCE),
        Parameter("rounding", "1", NONE, 0.0, 1.5, (0.1,), counts=False),
    ),
    meaning="overlap: small commands do nothing",
    source="Merritt, Hydraulic Control Systems, 1967: overlapped valve centre",
    experiment="slow motion of small amplitude, so that the command dwells around zero",
    stiffer=(1.0, 3.0),
)


@njit(cache=True, nogil=True, inline="always")
def beyond(excess: float, corner: float) -> float:
    """max(excess, 0) with a parabola of half width `corner` round the corner."""
    if excess >= corner:
        return excess
    if excess <= -corner:
        return 0.0
    return 0.25 * (excess + corner) ** 2 / corner


@njit(cache=True, nogil=True, inline="always")
def deadband(opening: float, half_width: float, rounding: float) -> float:
    """What is left of an opening beyond ± half_width; `rounding` is the half width of the corner as a share of that."""
    corner = rounding * half_width
    return beyond(opening - half_width, corner) - beyond(-opening - half_width, corner)
