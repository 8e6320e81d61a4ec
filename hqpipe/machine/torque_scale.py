"""The torque sensor has a gain error: the logged torque is too large by `ratio`."""

from __future__ import annotations

from hqpipe.machine.effect import NONE, Effect, Parameter, Search

EFFECT = Effect(
    name="torque_scale",
    layer="sensing",
    parameters=(Parameter("ratio", "1", Search(NONE, 0.2, 5.0, (1.0,))),),
    meaning="the torque reading is off by a factor",
    source="calibration error of load cells and pressure transducers",
    experiment="log the chamber pressures beside the torque, or load the joint with a known weight",
    advice="Calibrate the sensor with a known weight on a known lever.",
    shows_as=("load",),
    multiplies=("k1", "k3"),  # what is in units of torque: k2 is not, and k4 is per radian
    of_the_log=True,
)
