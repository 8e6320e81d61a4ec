"""The torque sensor has an offset."""

from __future__ import annotations

from hqpipe.machine.effect import COMMAND_SIDE, EFFORT, Effect, Parameter

EFFECT = Effect(
    name="torque_bias",
    layer="sensing",
    stage="output",
    parameters=(Parameter("nm", "N·m", EFFORT, -2.0, 2.0, (0.1, -0.1), anew=COMMAND_SIDE),),
    meaning="the logged torque is offset",
    source="zero drift of load cells and pressure transducers (data sheets)",
    experiment="hang the leg freely in several poses and compare with its weight",
)
