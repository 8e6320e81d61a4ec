"""Transport delay of what the controller puts out: the valve answers to the position error of a little earlier."""

from __future__ import annotations

from hqpipe.machine.effect import SECOND, Delay, Effect, Parameter, Search

EFFECT = Effect(
    name="valve_delay",
    layer="actuator",
    parameters=(Parameter("delay_s", "s", Search(SECOND, 0.0, 0.08, (0.003, 0.012, 0.03))),),
    meaning="the valve acts later than the controller asks it to",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: dead time of amplifier and pilot stage",
    experiment="let the load or a person move the joint while its command is held, fast enough for the delay to show",
    advice="Look for the delay between the controller and the spool (valve driver, its bus, the pilot stage); it "
    "lies inside the position loop, so it limits the gain. Give the rest to the simulator.",
    shows_as=("late",),
    blocks=(Delay(("opening",), "delay_s"),),
)
