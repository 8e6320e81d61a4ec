"""The torque is logged later than position and command (or earlier, if negative)."""

from __future__ import annotations

from hqpipe.machine.effect import SECOND, Delay, Effect, Parameter, Search

EFFECT = Effect(
    name="channel_skew",
    layer="sensing",
    parameters=(Parameter("skew_s", "s", Search(SECOND, -0.02, 0.05, (0.003, 0.012, -0.003))),),
    meaning="torque is logged later than position",
    source="time stamps taken at the logger instead of at the sensor; e.g. the CANopen SYNC specification CiA 301",
    experiment="a fast motion that the load causes, not the command: push the joint, or step a neighbouring one",
    advice="Stamp both channels at their source, or shift the later one by this much before the fit: it is an error "
    "of the log, not of the machine.",
    shows_as=("late",),
    blocks=(Delay(("command", "position", "velocity", "sliding"), "skew_s", logged=True),),
    of_the_log=True,
)
