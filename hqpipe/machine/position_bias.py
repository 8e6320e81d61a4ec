"""The position that the controller works with differs from the logged one by a constant, behind its integrator if any."""

from __future__ import annotations

from hqpipe.machine.effect import ANGLE, Block, Effect, Parameter, Search
from hqpipe.machine.sums import added

EFFECT = Effect(
    name="position_bias",
    layer="sensing",
    parameters=(Parameter("rad", "rad", Search(ANGLE, -1.0, 1.0, (0.02, -0.02))),),
    meaning="the joint's zero is off",
    source="null shift of a servo valve (Merritt, 1967); without an integrator an encoder zero shows the same way",
    experiment="hold the joint still at several loads in both directions; a second position sensor",
    advice="Redo the joint's zero against a jig or an end stop.",
    shows_as=("offset",),
    excludes=("torque_bias",),
    blocks=(Block(added, ("opening", "rad"), ("opening",), ("rad",)),),
)
