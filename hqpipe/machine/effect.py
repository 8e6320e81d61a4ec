"""What a candidate effect says of itself; its compiled part is a scalar function in the same file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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
        neutral: value in the rows of joints without the effect; the first parameter's is 0.
        anew: what the loops compute anew when it changes, beside the core: where the friction points before each window
            (FRICTION), what travel leaves of that too (SLIDING), the command side (COMMAND_SIDE), the supply too
            (SUPPLY), or everything (ALL_INPUTS). None: by the effect's stage, COMMAND_SIDE up to "command", then CORE.
        beside: the effect without which this number does nothing; it is fitted only in a set that has both.
        modes: control modes in which it is fitted; in others it stays neutral.
        least: of an inverse torque, times the largest torque logged: below it in every joint the effect is no fault,
            because every machine has that much of it.
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
    beside: str | None = None
    modes: tuple[str, ...] = MODES
    neutral: float = 0.0
    anew: str | None = None

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
        modes: control modes whose logs can show it; none where the base model's own coefficients take it up completely.
        effort_sources: kinds of torque measurement that it lies in front of; None if all.
        machine: one set of parameters for the whole machine by nature.
        least_joints: how many joints a log needs to show it.
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
    machine: bool = False
    least_joints: int = 1
    derived: tuple[Derived, ...] = ()
