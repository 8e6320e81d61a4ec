"""Transport delay of the command: the controller answers to what was sent a little earlier."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import SECOND, Delay, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def delayed(signal: np.ndarray, first: int, last: int, k: int, lag: float) -> float:
    """`signal` at sample k − lag by linear interpolation, held beyond `first` and `last`."""
    at = min(max(k - lag, float(first)), float(last))
    whole = min(int(at), last - 1)
    part = at - whole
    return signal[whole] + part * (signal[whole + 1] - signal[whole])


EFFECT = Effect(
    name="command_delay",
    layer="actuator",
    parameters=(Parameter("delay_s", "s", Search(SECOND, 0.0, 0.08, (0.003, 0.012, 0.03))),),
    meaning="transport delay of the command",
    source="Hwangbo et al., Science Robotics 4, 2019, who found such delays decisive for transfer",
    experiment="steps or a chirp of the command up to the bandwidth of the joint",
    blocks=(Delay(("command",), "delay_s"),),
)
