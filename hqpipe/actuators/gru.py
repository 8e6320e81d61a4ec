"""A gated recurrent unit as actuator model."""

from __future__ import annotations

from hqpipe.actuators.loops import net_step
from hqpipe.actuators.net import NetActuator


class GRU(NetActuator):
    """A net with one layer of gated recurrent units (Cho et al. 2014), the paper's best neural rival.

    The paper gives the size (48, 64, 12) and nothing else: we read torque, target, position and velocity of 12 joints in, the
    torques of the next sample out. Its state is zero after a reset.
    """

    NAME = "gru"
    KIND = net_step.GRU
    GATES, STATES = 3, 1
