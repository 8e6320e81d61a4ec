"""Underlap of the spool: within ± half_width of its centre all lands are open. There both edges of a port pass oil, so that the
flow grows twice as fast with the command, and oil leaks from one side to the other past the centre."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import COMMAND, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def widened(opening: float, half_width: float) -> float:
    """What the lands open together: the opening, and as much again within ± half_width."""
    return opening + min(max(opening, -half_width), half_width)


@njit(cache=True, nogil=True, inline="always")
def seeped(leak: float, opening: float, half_width: float, gain: float, inverse_limit: float) -> float:
    """Leakage in a sample with what passes the centre; in a sample no more leaks than there is.

    The land that closes passes w √(1 + τ/τ_max) where the one that opens loses w √(1 − τ/τ_max), w being what the first still
    is open: a difference of w τ/τ_max.

    Args:
        opening: behind `widened`. gain: of the base, N·m per opening and sample.
        inverse_limit: 1/τ_max of the orifices, 0 where the load bends no flow.
    """
    still_open = max(half_width - 0.5 * abs(opening), 0.0)
    return min(leak + gain * still_open * inverse_limit, 1.0)


EFFECT = Effect(
    name="valve_underlap",
    layer="actuator",
    parameters=(Parameter("half_width", "command", Search(COMMAND, 0.0, 3.0, (0.05, 0.3, 0.8))),),
    meaning="the valve is open round its centre, where it leaks and its gain is twice as large",
    source="Merritt, Hydraulic Control Systems, 1967: open-centre valves, flow gain and centre flow of underlapped spools",
    experiment="slow motion of small amplitude at several loads, so that the command dwells around zero",
    advice="Halve the gain within the underlap in the valve driver and simulate the leakage; where it has grown, edges of the "
    "spool are worn.",
    blocks=(
        Block(widened, ("opening", "half_width"), ("opening",), ("half_width",)),
        Block(
            seeped, ("leak", "opening", "half_width", "gain", "orifice_flow.effort_max_nm"), ("leak",), ("half_width",)
        ),
    ),
    excludes=("valve_deadband",),
)
