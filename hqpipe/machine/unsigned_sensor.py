"""A channel lost its sign: the log holds the absolute value."""

from __future__ import annotations

from hqpipe.machine.effect import Effect

EFFECT = Effect(
    name="unsigned_sensor",
    layer="sensing",
    parameters=(),
    meaning="a channel lost its sign",
    source="unsigned registers, e.g. the present-current register of serial-bus servos",
    experiment="read the sign bit; load the joint in a known direction",
    advice="Log the signed quantity, such as the difference of two pressures or the signed current; no model can be "
    "fitted without the sign.",
    of_the_log=True,
)
