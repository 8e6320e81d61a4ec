"""The torque sensor has a gain error."""

from __future__ import annotations

from hqpipe.machine.effect import NONE, Effect, Parameter

EFFECT = Effect(
    name="torque_scale",
    layer="sensing",
    stage="output",
    parameters=(Parameter("ratio", "1", NONE, 0.2, 5.0, (1.0,)),),
    meaning="the logged torque is too large by this ratio",
    source="calibration error of load cells and pressure transducers",
    experiment="log the chamber pressures beside the torque, or load the joint with a known weight",
    modes=(),
)
