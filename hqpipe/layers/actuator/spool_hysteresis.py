"""A spool that stays behind each reversal of the command: a generic shape, which no effect of the library describes.

The opening that is asked for passes through a play (Prandtl and Ishlinskii), and the law makes a flow of what comes out.
"""

from __future__ import annotations

import numpy as np

from hqpipe.identify.model import Effect, Parameter
from hqpipe.layers.actuator.sizes import Sizes
from hqpipe.layers.joint_motion.hysteresis import slipping_spring
from hqpipe.machine import effect as scales
from hqpipe.machine.chain import Signals

NAME = "hysteresis"
STARTS = (0.05, 0.2)
"""Of the usual opening, half of the play; assumption: a few per cent of the spool's stroke, of which commands use a part."""
USUAL, MOST = 0.1, 1.0  # likewise


def spool_hysteresis(size: Sizes, unit: str) -> Effect:
    """The shape; its number is half of the play. unit: of the position."""
    usual = size.of[scales.COMMAND]
    starts = tuple(start * usual for start in STARTS)
    play = Parameter("half_play", unit, 0.0, USUAL * usual, 0.0, MOST * usual, starts)
    return Effect(NAME, (play,), named=False, signal="command")


def command_behind(signals: Signals, half_play: float) -> np.ndarray:
    """(T,) commanded position that a spool without hysteresis would follow alike; half_play: rad or m, above 0."""
    found = signals.command.copy()
    for a, b in zip(signals.bounds[:-1], signals.bounds[1:], strict=True):
        opening = signals.command[a:b] - signals.position[a:b]
        found[a:b] -= half_play * slipping_spring(opening, half_play)
    return found
