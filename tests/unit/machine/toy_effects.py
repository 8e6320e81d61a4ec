"""Two effects that the package does not have, each as its file would be: one without a state, one with a state of its own."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import COMMAND, NONE, SECOND, Block, Constants, Effect, Parameter, Search, State
from hqpipe.machine.valve_lag import lag_share


@njit(cache=True, nogil=True, inline="always")
def notched(opening: float, inverse_doubled: float) -> float:
    """Opening × (1 + |opening| · inverse_doubled); 0 means a straight gain."""
    return opening * (1.0 + abs(opening) * inverse_doubled)


NOTCHES = Effect(
    name="metering_notches",
    layer="actuator",
    parameters=(Parameter("doubled_at", "command", Search(COMMAND, 0.0, 10.0, (0.1, 1.0)), inverse=True),),
    meaning="the flow gain grows with the opening",
    source="Merritt, Hydraulic Control Systems, 1967: ports whose width grows with the stroke",
    experiment="slow and fast motion of the same joint without load, so that small and large openings occur",
    advice="Divide the command by the gain at its opening in the valve driver.",
    blocks=(Block(notched, ("opening", "doubled_at"), ("opening",), ("doubled_at",)),),
)


@njit(cache=True, nogil=True, inline="always")
def sagged(opening: float, risen: float, share: float, step: float) -> tuple[float, float]:
    """The opening less a share of what rises behind it, and that after the sample."""
    return opening - share * risen, risen + step * (opening - risen)


PILOT = Effect(
    name="pilot_sag",
    layer="actuator",
    parameters=(
        Parameter("share", "1", Search(NONE, 0.0, 0.95, (0.1, 0.5))),
        Parameter("time_s", "s", Search(SECOND, 0.02, 2.0, (0.1,), counts=False), neutral=0.1),
    ),
    meaning="the pilot pressure sags while the valve is open and takes a share of the opening",
    source="Merritt, Hydraulic Control Systems, 1967: two-stage valves",
    experiment="steps of the command that are held for some seconds",
    advice="Look at the orifice that feeds the pilot stage.",
    blocks=(Block(sagged, ("opening", "risen", "share", "step"), ("opening", "risen"), ("share",)),),
    states=(State("risen"),),
    constants=(Constants(("step",), lag_share, ("time_s", "dt")),),
)

BOTH = (NOTCHES, PILOT)
