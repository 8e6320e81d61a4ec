"""The torque sensor has an offset."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import EFFORT, Block, Effect, Law, Parameter, Search
from hqpipe.machine.sums import added


@njit(cache=True, nogil=True, inline="always")
def removed(measured: float, bias: float) -> float:
    """Torque without the offset, N·m."""
    return measured - bias


EFFECT = Effect(
    name="torque_bias",
    layer="sensing",
    parameters=(Parameter("nm", "N·m", Search(EFFORT, -2.0, 2.0, (0.1, -0.1), usual=0.03)),),
    meaning="the torque reading has an offset",
    source="zero drift of load cells and pressure transducers (data sheets)",
    experiment="hang the leg freely in several poses and compare with its weight",
    advice="Zero the sensor at rest and without load before each session, then record again.",
    shows_as=("offset",),
    blocks=(Block(added, ("measured", "nm"), ("measured",), ("nm",), undo=Law(removed, ("measured", "nm"))),),
    of_the_log=True,
)
