"""What the search found in the joints of a log set."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hqpipe.identify.model import JointModel, LayerJoints


@dataclass(frozen=True, eq=False)
class Fitted:
    """One joint with one set of effects, fitted to its fit samples.

    Attributes:
        effects: of the set, generic shapes included. values: (P,) see `hqpipe.identify.model.all_parameters`.
        error: (N,) at the fit samples. heldout: (M,) at the held-out ones, which no fit has seen.
    """

    effects: tuple[str, ...]
    values: np.ndarray
    error: np.ndarray
    heldout: np.ndarray


@dataclass(frozen=True)
class Number:
    """One parameter of a cause.

    Attributes:
        name, unit: as in diagnosis.json. value: most probable. ci95: interval that holds it with 95 %.
        reference: its value in an earlier record of the machine; None without one.
    """

    name: str
    unit: str
    value: float
    ci95: tuple[float, float]
    reference: float | None = None


@dataclass(frozen=True)
class JointCause:
    """An effect that one joint has.

    Attributes:
        probability: of the effect, all sets together. numbers: its parameters. confused_with: effects that take its place in
            sets that the logs cannot rule out. odds: of each of these sets against the one with the cause, those that fit as
            well being as likely beforehand; not of effects that no log could tell apart.
        shown_by: what shows it in the errors; empty for one that a fit found.
    """

    effect: str
    probability: float
    numbers: tuple[Number, ...]
    confused_with: tuple[str, ...] = ()
    odds: tuple[float, ...] = ()
    shown_by: str = ""


@dataclass(frozen=True)
class BesideUnknown:
    """A cause beside what nothing explains, both at the frequencies at which the effects of the joint act.

    Attributes:
        closes: what the cause closes as the last one. unknown: what is left above the noise without generic shapes. Both as
            shares of the squared error of the base on data left out of its fit.
    """

    closes: float
    unknown: float


@dataclass(frozen=True, eq=False)
class SetNumbers:
    """How sure the numbers of one set of effects are: a normal distribution within bounds.

    Attributes:
        values: (P,) of all parameters, see `hqpipe.identify.model.all_parameters`. free: (F,) places of those of the set.
        covariance: (F, F). low, high: (F,) bounds.
    """

    values: np.ndarray
    free: np.ndarray
    covariance: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Exchange:
    """One effect in the place of a cause, in all joints of the machine that have the cause.

    Attributes:
        leaves, joins: the cause and the other effect. odds: of the second against the first, the same in all these joints.
        numbers: of this joint with the second.
    """

    leaves: str
    joins: str
    odds: float
    numbers: SetNumbers


@dataclass(frozen=True, eq=False)
class JointFound:
    """The answer for one joint.

    Attributes:
        base: without any effect. named: with the causes alone: what is left unexplained is its error. kept: with the generic
            shapes that close enough to be kept besides; the numbers of the causes are those found here, corrected for
            tolerances of the model. full: with all that the logs ask for: what could be predicted at all. In all of them stands
            what the rest of the machine does to the joint, where the logs ask for it.
        causes: the largest first. without: cause → the joint with all causes but this one, fitted again.
        probabilities: effect → probability, of all that were considered, generic shapes included.
        gains: effect → ln of how much more probable the logs are with it than without it, beside the set that was found.
        shapes: signal of each generic shape that closes enough to be kept → share of the squared error of `named` on the fit
            samples that it closes.
        unexplained: what is left above the noise, as a share of the squared error of `base` on data left out of its fit.
        beside_unknown: cause → what it closes beside what is left.
        visible: named effect that the joint was not given → how far from neutral its first number would have to be for these
            logs to name it; those that the joint's other numbers can imitate are left out.
        drifts: numbers that differ between trials by more than chance, as sentences.
        withdrawn: effects that the fit trials ask for and that do not show in the held-out ones. minor: effects that
            they ask for and that are small beside what is left unexplained.
        numbers: how sure those of a simulator's model are; None where nobody asked. exchanges: other sets that it may have.
    """

    model: JointModel
    base: Fitted
    named: Fitted
    kept: Fitted
    full: Fitted
    causes: tuple[JointCause, ...]
    without: dict[str, Fitted]
    probabilities: dict[str, float]
    gains: dict[str, float]
    shapes: dict[str, float]
    unexplained: float = 0.0
    beside_unknown: dict[str, BesideUnknown] = field(default_factory=dict)
    visible: dict[str, float] = field(default_factory=dict)
    drifts: tuple[str, ...] = ()
    withdrawn: tuple[str, ...] = ()
    minor: tuple[str, ...] = ()
    numbers: SetNumbers | None = None
    exchanges: tuple[Exchange, ...] = ()


@dataclass(frozen=True, eq=False)
class LayerFound:
    """The answer for all joints of a layer; `identify(joints, …)` makes it."""

    joints: LayerJoints
    found: tuple[JointFound, ...]
