"""What a candidate effect says of itself; its compiled part is a scalar function in the same file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

POSITION, TORQUE = "position", "torque"
MODES = (POSITION, TORQUE)
CORE, FRICTION, SLIDING, SUPPLY, COMMAND_SIDE, ALL_INPUTS = (  # of the loops, see Parameter.anew
    "core",
    "friction",
    "sliding",
    "supply",
    "command side",
    "all inputs",
)

# What a bound or a start value is a multiple of; the numbers come from the fit trials.
SECOND, COMMAND, EFFORT, VELOCITY, SLOWNESS, FLOW, DAMPING, STIFFNESS, ANGLE, NONE = (
    "second",
    "command",
    "effort",
    "velocity",
    "slowness",
    "flow",
    "damping",
    "stiffness",
    "angle",
    "none",
)


SIMPLIFIED = (
    0.012  # see Parameter; measured on withheld cases of a plant of its own equations (docs/theory/diagnosis.md)
)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: key in diagnosis.json, with its unit where it is not that of the command.
        unit: SI unit for a revolute joint; "command" stands for the unit of the position or torque command.
        scale: what `lower`, `upper` and `starts` are multiples of: second, command (RMS of the position or torque
            error), effort and velocity (RMS), slowness (one over the RMS of the
            machine's total speed), flow (that RMS), damping (effort over velocity), stiffness (effort over travel), angle
            (standard deviation of the position) or none.
        lower, upper: bounds of the search.
        starts: where fits begin; several where an effect can be inactive over all data and then has no gradient.
        inverse: the fit works on one over the value, so that "absent" is 0 instead of infinity; bounds and
            starts are those of the inverse, in multiples of one over the scale.
        squared: of an inverse, that the fit works on its square, as what it does has no slope at "absent" otherwise.
        counts: False for a shape parameter: it cannot show by itself that the effect is there.
        simplified: standard deviation, as a share of the value, of what the effect's formula leaves out.
        neutral: value in the rows of joints without the effect; the first parameter's is 0.
        anew: what the loops compute anew when it changes, beside the core: where the friction points before each window
            (FRICTION), what travel leaves of that too (SLIDING), the command side (COMMAND_SIDE), the supply too
            (SUPPLY), or everything (ALL_INPUTS). None: by the effect's stage, COMMAND_SIDE up to "command", then CORE.
        yields_to: effects that say the same of most logs; beside one of them this number stays at its start.
        beside: the effect without which this number does nothing; it is fitted only in a set that has both.
        modes: control modes in which it is fitted; in others it stays neutral.
        least: of an inverse torque, times the largest torque logged: below it in every joint the effect is no fault,
            because every machine has that much of it.
        built_from: size from which a machine is likely to be built so, see `Effect.stands_for`.
    """

    name: str
    unit: str
    scale: str
    lower: float
    upper: float
    starts: tuple[float, ...]
    inverse: bool = False
    squared: bool = False
    counts: bool = True
    least: float = 0.0
    simplified: float = SIMPLIFIED
    yields_to: tuple[str, ...] = ()
    beside: str | None = None
    modes: tuple[str, ...] = MODES
    neutral: float = 0.0
    anew: str | None = None
    built_from: float = 0.0

    def told(self, fitted: float) -> float:
        """The number that the fit works on as it is reported; infinite where an inverse is 0."""
        if not self.inverse:
            return fitted
        inverse = float(np.sqrt(max(fitted, 0.0))) if self.squared else fitted
        return 1.0 / inverse if inverse else np.inf


@dataclass(frozen=True)
class Derived:
    """A quantity that is reported beside the numbers of an effect and follows from them.

    Attributes:
        name, unit: as in diagnosis.json. of: names of the numbers that it needs. function: of their values; never negative.
    """

    name: str
    unit: str
    of: tuple[str, ...]
    function: Callable[..., float]


@dataclass(frozen=True)
class Effect:
    """A candidate cause of the gap.

    Attributes:
        name: as in diagnosis.json.
        layer: "actuator" or "sensing".
        stage: where it acts, in the order of the chain: "clock", "command", "core" or "output".
        parameters: its numbers. derived: what follows from them.
        meaning: one line.
        source: where the form comes from.
        experiment: what to record so that it shows.
        modes: control modes whose logs can show it.
        effort_sources: kinds of torque measurement that it lies in front of; None if all.
        absorbed: control modes in which the base model's own coefficients take it up completely.
        stiffer: factors on k1 and k3 to start from: a base model that lacks the effect may have fitted them too low.
        machine: one set of parameters for the whole machine by nature.
        least_joints: how many joints a log needs to show it.
        stands_for: effect that is named instead where a joint's logs cannot tell the two apart and a number of the other one
            has the size that machines are built with (`Parameter.built_from`).
    """

    name: str
    layer: str
    stage: str
    parameters: tuple[Parameter, ...]
    meaning: str
    source: str
    experiment: str
    modes: tuple[str, ...] = MODES
    effort_sources: tuple[str, ...] | None = None
    absorbed: tuple[str, ...] = field(default=())
    stiffer: tuple[float, ...] = (1.0,)
    machine: bool = False
    least_joints: int = 1
    stands_for: str | None = None
    derived: tuple[Derived, ...] = ()
