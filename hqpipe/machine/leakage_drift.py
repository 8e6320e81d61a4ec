"""Leakage changes through the trial, as warm oil is thinner: what holds the torque lets go of it faster."""

from __future__ import annotations

import numpy as np
from numba import njit

from hqpipe.machine.effect import NONE, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def leaked(leakage: float, rate: float, time: float) -> float:
    """Leakage × exp(rate · time); in a sample no more leaks than there is."""
    return min(leakage * np.exp(rate * time), 1.0) if rate != 0.0 else leakage


EFFECT = Effect(
    name="leakage_drift",
    layer="actuator",
    # An oil that loses 3 % of its viscosity a kelvin and warms by 1 K/s leaks 3 % more each second; ten times that is a fire.
    parameters=(Parameter("rate_per_s", "1/s", Search(NONE, -0.3, 0.3, (0.02, -0.02))),),
    meaning="leakage changes in the course of a trial, as oil gets thinner with its temperature",
    source="Merritt, Hydraulic Control Systems, 1967: laminar leakage over a viscosity that falls exponentially as it warms",
    experiment="one long trial of steady excitation, from cold",
    advice="Warm the oil up before recording and log its temperature; a rate far beyond what the viscosity of the "
    "oil does per kelvin points at seals. Vary the leakage over this range in training.",
    shows_as=("warming",),
    blocks=(Block(leaked, ("leak", "rate_per_s", "time"), ("leak",), ("rate_per_s",)),),
)
