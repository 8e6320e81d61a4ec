"""What a layer gives for one joint: numbered samples, parameters, and the error of a prediction with them.

A model holds its base and every effect at once. An effect is left out by its parameters' neutral values, at which the
prediction is bit for bit that of the model without it. So one compiled prediction serves all sets of effects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from hqpipe.identify.thresholds import CELLS, MATERIAL

STATES = CELLS**2
FORCE_SENSOR = 0.01
"""Class of a force sensor over the spread of what it measures, half of its full scale at most: pressure transmitters and load
cells of 0.5 % of full scale, as data sheets of industrial ones say. A smaller error may be the sensor's own. The cost: an
unknown effect that small counts as no gap."""


@dataclass(frozen=True)
class Parameter:
    """One number of a joint.

    Attributes:
        name: as in diagnosis.json, e.g. "friction_nm". unit: of the joint, SI.
        neutral: value at which it does nothing; of a base parameter, where the fit starts.
        spread: size that a data sheet of such a machine would give, as a deviation from `neutral`: the width of the Cauchy
            prior. Infinite for a base parameter about which nothing is known.
        low, high: bounds.
        starts: values from which a fit is tried when it is first freed; none for one step of the size `spread`.
        least: deviation from `neutral` that every sound machine may have.
        shape: whether it only shapes what the other numbers of its effect do, which can also do without it.
    """

    name: str
    unit: str
    neutral: float
    spread: float
    low: float = -np.inf
    high: float = np.inf
    starts: tuple[float, ...] = ()
    least: float = 0.0
    shape: bool = False


@dataclass(frozen=True)
class Effect:
    """A candidate cause.

    Attributes:
        name: as in the table of effects. parameters: freed together.
        named: False for a generic shape, which stands for what no effect of the library describes; what it closes is unknown.
        signal: of a generic shape, the signal on which the error depends, e.g. "position".
        context: of a generic shape, that it is what the rest of the machine does to the joint, which is no gap of the joint:
            where the logs ask for it, it stands beside the base and beside the causes.
        in_both: of two records, that both have it: no change, and so part of the machine beside which changes are judged.
        excludes: names of effects that mean the same in these logs, of which at most one is in a set.
        common: whether as many joints have it as not, as friction; others are as likely as one effect a joint makes them.
        settled: numbers beside its parameters that the prediction takes from the logs by itself, as what an integrator held
            when a trial began.
    """

    name: str
    parameters: tuple[Parameter, ...]
    named: bool = True
    signal: str = ""
    context: bool = False
    in_both: bool = False
    excludes: frozenset[str] = frozenset()
    common: bool = False
    settled: int = 0

    @property
    def sizes(self) -> int:
        """How many of its numbers say how large it is, and do not only shape what it does."""
        return sum(not parameter.shape for parameter in self.parameters)


@dataclass(frozen=True)
class Ratio:
    """What may change in a base by one ratio, now over then.

    Attributes:
        names: base parameters that stand for it. multiply: changes the values (P,) in place to those of the ratio.
        alike_below: effects that do to the output what a ratio below 1 does.
    """

    names: tuple[str, ...]
    multiply: Callable[[np.ndarray, float], None]
    alike_below: tuple[str, ...] = ()


@dataclass(frozen=True)
class Implied:
    """What numbers of effects imply of another one.

    Attributes:
        effect: its name. parameter, unit, value: its number, as `Parameter` has it, above 0.
        beyond: logarithm of the number over the most that a sound machine has. most: of `beyond`, from where on it is not this
            effect.
    """

    effect: str
    parameter: str
    unit: str
    value: float
    beyond: float
    most: float


@dataclass(frozen=True, eq=False)
class Samples:
    """The samples on which a joint is judged, masked ones left out; in the order of time within each trial.

    Attributes:
        files: names of the trials. trial: (N,) index into them. time: (N,) s from the start of the trial.
        position, velocity: (N,) of the joint. output: (N,) what is predicted, as measured.
        held: (N,) the prediction of persistence: the output at the start of the window.
    """

    files: tuple[str, ...]
    trial: np.ndarray
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    output: np.ndarray
    held: np.ndarray

    @cached_property
    def state(self) -> np.ndarray:
        """(N,) number of the state of each sample, below `STATES`: a cell of position and speed, equally full in each."""
        return _sixth(self.position) * CELLS + _sixth(self.velocity)

    def only(self, kept: np.ndarray) -> Samples:
        """Those that are True in a mask (N,)."""
        names = ("trial", "time", "position", "velocity", "output", "held")
        return Samples(self.files, *(getattr(self, name)[kept] for name in names))


class JointModel(Protocol):
    """One joint of one log set in one layer.

    Attributes:
        joint: name. unit: of the output. dt: s, time from a sample to the next.
        base: parameters that every machine of this kind has; always free.
        effects: candidates.
        fit, heldout: samples of the trials of each split; `heldout` may hold none.
        noise: (fit, held-out) root mean square that sensor noise alone leaves in the error of a perfect model.
        notes: what an answer should say of this joint, one sentence each.

    It may have `changes`: cause → names of the base parameters that change with it from one record of the machine to another;
    or `ratios`: cause → `Ratio`, where all of what may change in its base goes by ratios.
    It may have `begin`: names of effects that the joint is likely to have, and values (P,) with them.
    It may have `idle(values)`: places of parameters that change nothing at these values, so that no difference is taken there.
    It may have `misfit(values, heldout)`, what of the error counts when sets of effects are compared, with `misfit_noise`, see
    `hqpipe.identify.misfit`.
    It may have `beyond(values)`: names of effects whose numbers no such machine can have beside the others.
    It may have `sound_sizes(values)`: effect → size of its first number that a sound machine may have beside the others, where
    that is more than its `least`.
    It may have `same_by_law(values)`: effect → effects of the library that would do the same, among `effects` or not.
    It may have `sensitivity(values, index)`: (N,) exact derivative of what counts at the fit samples by one parameter, or None
    where it is to be taken as a difference.
    It may have `tolerances(values)`: (N, K) what each thing that is known to within a tolerance, and is no candidate, does to
    what counts at the fit samples, if it is off by its standard deviation.
    It may have `implied(values)`: what the numbers imply, see `Implied`, and `limited()`: the same joint with a law in which
    that is no more than a sound machine has.
    It may have `vibration_shows`: the effect that a vibration shows in what its law leaves, empty where none does.
    It may have `remarks(causes, values)`: what the numbers of a fit say beside the causes' parameters, one sentence each.
    """

    joint: str
    unit: str
    dt: float
    base: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    fit: Samples
    heldout: Samples
    noise: tuple[float, float]
    notes: tuple[str, ...]

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        """(N,) prediction less measured output at the samples of `fit` or `heldout`.

        Args:
            values: (P,) base parameters, then those of all effects in their order; see `all_parameters`.
        """
        ...


def all_parameters(model: JointModel) -> tuple[Parameter, ...]:
    """Base parameters, then those of all effects in their order: the order of `values`."""
    return (*model.base, *(parameter for effect in model.effects for parameter in effect.parameters))


def parameter_names(model: JointModel) -> list[tuple[str, str]]:
    """(effect, parameter) of all parameters in the order of the values; no effect for the base."""
    own = [("", parameter.name) for parameter in model.base]
    return own + [(effect.name, parameter.name) for effect in model.effects for parameter in effect.parameters]


def positions(model: JointModel, effects: Sequence[str]) -> np.ndarray:
    """Indices into `values` of the base parameters and those of the named effects."""
    found = list(range(len(model.base)))
    at = len(model.base)
    for effect in model.effects:
        if effect.name in effects:
            found += range(at, at + len(effect.parameters))
        at += len(effect.parameters)
    return np.array(found, dtype=np.int64)


def _sixth(values: np.ndarray) -> np.ndarray:
    edges = np.quantile(values, np.linspace(0.0, 1.0, CELLS + 1)[1:-1])
    return np.searchsorted(edges, values)


@dataclass(frozen=True, eq=False)
class LayerJoints:
    """All joints of a log set in one layer.

    Attributes:
        layer: its name. metric: what the error is, as in diagnosis.json. window_s: s, length of a free run, or of the filter.
        window_reason: why. models: the joints that can be judged. left: joint → why it cannot be. warnings: what to know.
        material: share of the output's spread, below which a gap does not matter.
    """

    layer: str
    metric: str
    window_s: float
    window_reason: str
    models: tuple[JointModel, ...]
    left: dict[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    material: float = MATERIAL
