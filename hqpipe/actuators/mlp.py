"""A multilayer perceptron as actuator model."""

from __future__ import annotations

from hqpipe.actuators.loops import net_step
from hqpipe.actuators.net import NetActuator


class MLP(NetActuator):
    """A net with one hidden layer, as the paper's rival and, with taps, after Hwangbo et al. 2019.

    The paper gives the size (48, 64, 12) and nothing else: we read torque, target, position and velocity of 12 joints in, the
    torques of the next sample out. Hwangbo et al. (Science Robotics 4, eaau5872) add the inputs of 10 and 20 ms ago and use
    the softsign function, as it is done here.
    """

    NAME = "mlp"
    KIND = net_step.MLP
    GATES, STATES, LOOKS_BACK = 1, 0, True
