"""A long short-term memory as actuator model."""

from __future__ import annotations

from hqpipe.actuators.loops import net_step
from hqpipe.actuators.net import NetActuator


class LSTM(NetActuator):
    """A net with one layer of long short-term memory (Hochreiter and Schmidhuber 1997), the paper's rival.

    The paper gives the size (48, 64, 12) and nothing else: we read torque, target, position and velocity of 12 joints in, the
    torques of the next sample out. Its state is zero after a reset.
    """

    NAME = "lstm"
    KIND = net_step.LSTM
    GATES, STATES = 4, 2
