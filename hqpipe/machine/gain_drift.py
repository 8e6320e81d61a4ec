"""The flow gain changes steadily through the trial, as oil and driver warm."""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import NONE, Block, Effect, Parameter, Search


@njit(cache=True, nogil=True, inline="always")
def drifted(opening: float, rate: float, time: float) -> float:
    """Opening × (1 + rate · time), never below zero gain."""
    return opening * max(1.0 + rate * time, 0.0)


EFFECT = Effect(
    name="gain_drift",
    layer="actuator",
    parameters=(Parameter("rate_per_s", "1/s", Search(NONE, -0.2, 0.2, (0.01, -0.01))),),
    meaning="the gain changes in the course of a trial, as with warming oil",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: temperature dependence of viscosity and modulus",
    experiment="one long trial of steady excitation, from cold",
    advice="Warm the oil up before recording and log its temperature; vary the gain over this range in training.",
    shows_as=("gain", "warming"),
    blocks=(Block(drifted, ("opening", "rate_per_s", "time"), ("opening",), ("rate_per_s",)),),
)
