"""The valve passes more in one direction than in the other.

A cylinder with a rod on one side does so too, and what the supply can lift differs with the direction as the areas do:
`areas` is (A₊ − A₋)/(A₊ + A₋), read by `hqpipe.machine.orifice_flow`. A torque sensor with an offset of that
share of the largest torque would say the same of position mode. Only a tenth and more, as of a rod on one side, is no sensor's;
what sides that are meant to be alike may differ by (`ALIKE_WITHIN`) is a tolerance of the model.
"""

from __future__ import annotations

from numba import njit

from hqpipe.machine.effect import NONE, Block, Effect, Parameter, Search

LEAST_UNEQUAL = 0.029
"""Of `areas`: (φ − 1)/(φ + 1) of φ = 1.06, the smallest ratio of the two areas in standard series (ISO 7181): a rod of a
quarter of the piston's diameter. Assumption: no cylinder has a thinner one. Smaller values times the largest torque are told as
an offset, which has its own name, with this effect beside it."""
ALIKE_WITHIN = 0.005
"""Of `areas`: how far apart two sides that are meant to be alike may count. The torque is the difference of their pressures
times their areas, and pressure transmitters are of 0.5 % of full scale, as data sheets of industrial ones say; the areas of
bores of the tolerance H9 (ISO 286-2, 40 mm) differ by up to 0.3 %."""
MOST_UNEQUAL = 0.5  # a rod that leaves a third of the piston's area; larger ones are not built; assumption


@njit(cache=True, nogil=True, inline="always")
def asymmetric(opening: float, ratio: float) -> float:
    """Opening × (1 + ratio · sgn opening)."""
    return opening + ratio * abs(opening)


EFFECT = Effect(
    name="direction_asymmetry",
    layer="actuator",
    parameters=(
        Parameter("ratio", "1", Search(NONE, -0.95, 0.95, (0.1, -0.1))),
        Parameter("areas", "1", Search(NONE, -MOST_UNEQUAL, MOST_UNEQUAL, (0.0, -0.17, 0.17), counts=False)),
    ),
    meaning="extending and retracting have different gains: unequal areas or an unmeasured constant load",
    source="Jelali & Kroll, Hydraulic Servo-systems, 2003: differential cylinders and asymmetric lands",
    experiment="motion at several speeds in both directions, the same ones in each",
    advice="Give each direction its own gain in the valve driver, the two piston areas differ; the ratio should then "
    "come out as zero.",
    shows_as=("gain",),
    blocks=(Block(asymmetric, ("opening", "ratio"), ("opening",), ("ratio",)),),
)
