"""What an effect says of itself: its physics as blocks of the chain, and what the search for causes needs to know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

# What a bound or a start value is a multiple of; the numbers come from the fit trials.
SECOND, COMMAND, EFFORT, VELOCITY, USUAL_VELOCITY, SLOWNESS, FLOW, DAMPING, STIFFNESS, ANGLE, TRAVEL, CURVE, NONE = (
    "second",
    "command",
    "effort",
    "velocity",
    "usual_velocity",
    "slowness",
    "flow",
    "damping",
    "stiffness",
    "angle",
    "travel",
    "curve",
    "none",
)


@dataclass(frozen=True)
class Search:
    """How a fit looks for a parameter.

    Attributes:
        scale: what the others are multiples of: second, command (RMS of the position error), effort and velocity (RMS),
            usual_velocity (that of the middle joint of the machine, where this one is slower), slowness (one over the RMS of
            the machine's total speed), flow (that RMS), damping (effort over velocity), stiffness (effort over travel), angle
            (standard deviation of the position), travel (half of a usual stroke: 1 rad, and of a joint that slides the range
            of its positions), curve (one over travel) or none.
        lower, upper: bounds.
        starts: where fits begin; several where an effect can be inactive over all data and then has no gradient.
        counts: False for a shape parameter: it cannot show by itself that the effect is there.
        usual: usual size; None for the least of the starts.
        least: of an inverse torque, times the largest torque logged: below it in every joint the effect is no fault,
            because every machine has that much of it.
        beside: the effect in whose set it is fitted, as it does nothing without that one; None for its own. "friction": it
            does nothing without friction of some kind, and is fitted with the coefficients.
        pauses: whether it shows only in logs in which little flow is drawn at times.
    """

    scale: str
    lower: float
    upper: float
    starts: tuple[float, ...]
    counts: bool = True
    usual: float | None = None
    least: float = 0.0
    beside: str | None = None
    pauses: bool = False


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: key in diagnosis.json, with its unit where it is not that of the command.
        unit: SI unit for a revolute joint; "command" stands for the unit of the position command.
        search: how a fit looks for it.
        inverse: the chain holds one over the value, so that "absent" is 0 instead of infinity; bounds and
            starts are those of the inverse, in multiples of one over the scale.
        squared: whether the chain holds the square, as what it does has no slope at "absent" otherwise; bounds and starts are
            those of the square.
        neutral: value in the rows of joints without the effect; that of the first parameter is 0.
    """

    name: str
    unit: str
    search: Search
    inverse: bool = False
    squared: bool = False
    neutral: float = 0.0

    def told(self, fitted: float) -> float:
        """The number that the chain holds as it is reported; infinite where an inverse is 0."""
        held = float(np.sqrt(max(fitted, 0.0))) if self.squared else fitted
        if not self.inverse:
            return held
        return 1.0 / held if held else np.inf


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
class Law:
    """A compiled scalar function and the names of what its arguments are."""

    function: Callable[..., float]
    reads: tuple[str, ...]


@dataclass(frozen=True)
class Constants:
    """What follows from a row of parameters once and for all.

    Attributes:
        names: one for each value of the function. neutral: each of them where the effect is absent.
        when: parameters that are all 0 where it is; none: those that the function reads.
    """

    names: tuple[str, ...]
    function: Callable[..., float | tuple[float, ...]]
    reads: tuple[str, ...]
    neutral: float = 0.0
    when: tuple[str, ...] = ()


@dataclass(frozen=True)
class Balanced:
    """Start of a state that only the whole trial tells: the one with which the torques of the law add up to the logged ones.

    Attributes:
        limit: law of the largest absolute value of the state.
        known: law of the state at the first sample where `held` (s) says for how long the joint had been held before.
    """

    limit: Law
    known: Law


@dataclass(frozen=True)
class State:
    """What a block remembers from one sample to the next.

    Attributes:
        name: as blocks read and write it. start: at the first sample, a number, the name of a signal, or a law.
        moved_by: signal by which, beside others, it moves between −1 and 1 in a sample. At an end it forgets where it began, so
            that a log need not be followed from its beginning to know it; None where something may be remembered for ever.
    """

    name: str
    start: float | str | Law | Balanced = 0.0
    moved_by: str | None = None


@dataclass(frozen=True)
class Block:
    """One link of the chain: signals, parameters, constants and states in, signals and states out.

    Names are looked up among the effect's own parameters first; `effect.parameter` is one of another effect.

    Attributes:
        writes: names of what the function returns, in its order.
        when: the block is absent where all of these are 0 or, of signals, not written by any block that is present.
        undo: where the block lies behind the hydraulics, the law of what is in front of it; see hqpipe.machine.signals.
        only_delays: what comes in goes out later, and over a trial the same adds up.
    """

    function: Callable[..., float | tuple[float, ...]]
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    when: tuple[str, ...]
    undo: Law | None = None
    only_delays: bool = False


@dataclass(frozen=True)
class Delay:
    """A signal later, by linear interpolation between samples; before the first sample, that one.

    Attributes:
        signals: names. by: the parameter with the delay, s. logged: it is a delay of the log and none of the machine; it may be
            negative.
    """

    signals: tuple[str, ...]
    by: str
    logged: bool = False


@dataclass(frozen=True)
class Effect:
    """A candidate cause of the gap.

    Attributes:
        name: as in diagnosis.json.
        layer: "actuator" or "sensing".
        parameters: its numbers. derived: what follows from them.
        meaning: what it is, in half a sentence of the report.
        source: where the form comes from.
        experiment: what to record so that it shows.
        advice: what an engineer can do about it, in a sentence of the report.
        shows_as: kinds of error that logs show of it: friction, load friction, load, offset, late, limit, play, gain, warming;
            what to record to tell two of a kind apart is in hqpipe.gap.answer.layer_experiment.
        blocks, states, constants: what it does in the chain; no blocks: it is read off other channels, see hqpipe.gap.
        multiplies: coefficients of the base whose rates it does nothing but multiply by one number. They take it up completely,
            so that no fit finds it; only between two records of a machine it shows, as a ratio. Where a change of the machine
            multiplies the same ones, that ratio is at most 1.
        turns_friction: whether the travel in which friction turns round tells it all the same, where the torque is measured
            behind the friction.
        slack: whether it passes no torque within some travel: there the logged one is noise round zero, and does not say what
            the hydraulics hold.
        of_the_log: whether only the log has it, and a simulator not.
        common: whether every machine has some of it.
        effort_sources: kinds of torque measurement that it lies in front of; None if all.
        machine: one set of parameters for the whole machine by nature.
        least_joints: how many joints a log needs to show it.
        excludes: effects of which and of it a joint is told one at most: they are one number of a linear law, or of two signs.
    """

    name: str
    layer: str
    parameters: tuple[Parameter, ...]
    meaning: str
    source: str
    experiment: str
    advice: str
    shows_as: tuple[str, ...] = ()
    blocks: tuple[Block | Delay, ...] = ()
    states: tuple[State, ...] = ()
    constants: tuple[Constants, ...] = ()
    multiplies: tuple[str, ...] = ()
    turns_friction: bool = False
    slack: bool = False
    of_the_log: bool = False
    common: bool = False
    effort_sources: tuple[str, ...] | None = None
    machine: bool = False
    least_joints: int = 1
    excludes: tuple[str, ...] = ()
    derived: tuple[Derived, ...] = ()

    @property
    def laws(self) -> list[Callable[..., float]]:
        """The functions of its blocks."""
        return [block.function for block in self.blocks if isinstance(block, Block)]

    def reads(self, signal: str) -> bool:
        """Whether one of its blocks reads a signal."""
        return any(signal in block.reads for block in self.blocks if isinstance(block, Block))


@dataclass(frozen=True)
class Base:
    """A law from the inputs of a joint to its torque, which the effects bend.

    Attributes:
        name: of the model. parameters: name → unit.
        law: torque after the sample, N·m, with every signal that an effect may bend.
        plain: the same where none of them is bent.
        gain: the parameter that an opening is multiplied by. needed: law of the opening times the gain that holds a torque.
        signals: signal → number or parameter that it is without effects, beside those of hqpipe.machine.signals.
        constants: as of an effect. lacks: signals and states that such a drive does not have; blocks that write them are left
            out.
    """

    name: str
    parameters: dict[str, str]
    law: Law
    plain: Law
    gain: str
    needed: Law
    signals: dict[str, float | str] = field(default_factory=dict)
    constants: tuple[Constants, ...] = ()
    lacks: tuple[str, ...] = ()
