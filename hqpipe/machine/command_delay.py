"""Transport delay of the command: the controller answers to what was sent a little earlier."""

from __future__ import annotations

from hqpipe.machine.effect import SECOND, Delay, Effect, Parameter, Search

EFFECT = Effect(
    name="command_delay",
    layer="actuator",
    parameters=(Parameter("delay_s", "s", Search(SECOND, 0.0, 0.08, (0.003, 0.012, 0.03))),),
    meaning="the command acts later than it was given",
    source="Hwangbo et al., Science Robotics 4, 2019, who found such delays decisive for transfer",
    experiment="steps or a chirp of the command up to the bandwidth of the joint",
    advice="Look for the delay on the bus and in the control loop and remove what you can; give the rest to the "
    "simulator, and vary it a little in training.",
    shows_as=("late",),
    blocks=(Delay(("command",), "delay_s"),),
)
