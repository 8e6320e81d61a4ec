"""The valve is fully open: its spool follows a command beyond ± limit no further."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import COMMAND, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def saturate(opening: float, inverse_limit: float) -> float:
    """The command within ± 1/inverse_limit; 0 means no limit."""
    limit = 1.0 / max(inverse_limit, 1e-300)
    return min(max(opening, -limit), limit)


EFFECT = Effect(
    name="flow_saturation",
    layer="actuator",
    parameters=(
        Parameter("limit", "command", Search(COMMAND, 0.0, 1e3, (0.35, 0.7, 1.3, 2.0), usual=0.7), inverse=True),
    ),
    meaning="beyond a certain command the valve is fully open",
    source="Merritt, Hydraulic Control Systems, 1967: stroke of the spool",
    experiment="large steps, until the position error exceeds what the valve can serve",
    advice="Do not ask for more speed than the open valve gives: limit the command, lower the gain or fit a larger "
    "valve; train with the limit.",
    shows_as=("limit",),
    blocks=(Block(saturate, ("opening", "limit"), ("opening",), ("limit",)),),
)
