"""The supply pressure sags with the flow that the joints take together, one or many, and recovers.

A pump that gives less the lower the pressure makes a loss in proportion to the flow, with the lag of the accumulator: `droop`,
share of the pressure per rad/s of total speed. One that gives all it can makes none up to that flow, and beyond it the
accumulator empties: `pump_velocity_rad_s` with a long recovery.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import FLOW, SECOND, SLOWNESS, Block, Constants, Effect, Law, Parameter, Search, State
from hqpipe.machine.valve_lag import lag_share


@njit(cache=True, nogil=True, inline="always")
def lacking(demand: float, pump: float) -> float:
    """Flow that the accumulator has to give, beyond what the pump keeps up with; negative while it is filled. rad/s."""
    return demand - pump


@njit(cache=True, nogil=True, inline="always")
def sag(loss: float, demand: float, droop: float, share: float) -> float:
    """Relative pressure loss after one sample under the flow `demand`, counted as a total joint speed, rad/s.

    A full accumulator takes no more oil.
    """
    return max(loss + share * (droop * demand - loss), 0.0)


@njit(cache=True, nogil=True, inline="always")
def sagged(loss: float, demand: float, pump: float, droop: float, share: float) -> float:
    """Relative loss of pressure after one sample; arguments as of `lacking` and `sag`."""
    return sag(loss, lacking(demand, pump), droop, share)


@njit(cache=True, nogil=True, inline="always")
def steady(demand: float, pump: float, droop: float) -> float:
    """The loss if that flow has been drawn for long."""
    return max(droop * lacking(demand, pump), 0.0)


EFFECT = Effect(
    name="supply_droop",
    layer="actuator",
    parameters=(
        Parameter("droop", "s/rad", Search(SLOWNESS, 0.0, 3.0, (0.05, 0.15))),
        Parameter("recovery_s", "s", Search(SECOND, 0.003, 5.0, (0.03, 0.3), counts=False), neutral=0.1),
        Parameter("pump_velocity_rad_s", "rad/s", Search(FLOW, 0.0, 3.0, (0.0, 0.7), counts=False, pauses=True)),
    ),
    meaning="the supply pressure sags when all joints together draw much oil",
    source="Merritt, Hydraulic Control Systems, 1967: supply with accumulator, first order",
    experiment="all joints fast at the same time, then one joint alone; of one joint fast strokes after a rest, then slow ones",
    advice="Check the accumulator's precharge and the pump's flow limit, log the supply pressure, and train with the "
    "droop that all joints share.",
    shows_as=("limit",),
    machine=True,
    blocks=(Block(sagged, ("loss", "demand", "pump_velocity_rad_s", "droop", "recovered"), ("loss",), ("droop",)),),
    states=(State("loss", Law(steady, ("demand", "pump_velocity_rad_s", "droop"))),),
    constants=(Constants(("recovered",), lag_share, ("recovery_s", "dt")),),
)
