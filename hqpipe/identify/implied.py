"""Effects that numbers of others imply: a soft link between piston and joint, by the travel in which friction turns round.

Such a number belongs to what a search finds, and a search leaves it free. What the effect does to the output, the base has
taken up, so that it closes little, and the rules that ask for a share of the error do not apply. It is told where the number is
beyond what a sound machine has of it, as far as its interval and the other joints of the machine make that sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from hqpipe.identify.beliefs import BELIEVED
from hqpipe.identify.beside import rank_beside
from hqpipe.identify.found import Fitted, JointCause, JointFound, Number
from hqpipe.identify.intervals import normal_covariance
from hqpipe.identify.joint_answer import fitted
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.prior import MOST_JOINTS, expected_share
from hqpipe.identify.screening import Known
from hqpipe.identify.search import Search
from hqpipe.identify.thresholds import OVERSTATED
from hqpipe.identify.uncertainty import NORMAL

_STEP = 1e-4  # of a number, for the slope of what is implied; assumption: far above rounding, far below what bends it


@dataclass(frozen=True, eq=False)
class Reading:
    """What the numbers of a joint say of an effect that they imply.

    Attributes:
        effect: its name. number: its parameter. beyond: deviations by which it is beyond what a sound machine has.
        without: the joint with its causes, fitted with a law that keeps to that.
    """

    effect: str
    number: Number
    beyond: float
    without: Fitted


def readings(search: Search, kept: Known, named: Known) -> tuple[Reading, ...]:
    """What a finished search implies.

    Args:
        kept: the set that gives the numbers. named: the causes alone.
    """
    # Of its class: a model that wraps another one has other numbers than that.
    implied = getattr(type(search.model), "implied", None)
    if implied is None or not np.isfinite(kept.solution.square):
        return ()
    found = []
    for at, told in enumerate(implied(search.model, kept.solution.values)):
        if not 0.0 < told.beyond < told.most:
            continue
        deviation = _deviation(search, kept, at)
        ends = tuple(told.value * float(np.exp(side * NORMAL * deviation)) for side in (-1.0, 1.0))
        number = Number(told.parameter, told.unit, told.value, ends)
        without = _limited(search, named)
        if _bears_out(fitted(search, named), without):
            found.append(Reading(told.effect, number, told.beyond / deviation, without))
    return tuple(found)


def with_implied(answers: Sequence[JointFound], read: Sequence[Sequence[Reading]]) -> list[JointFound]:
    """The answers of a machine's joints, with what they imply.

    Of how many joints have an effect the same is known beforehand as of any other, and what few have is overstated likewise.

    Args:
        answers, read: of each joint.
    """
    answers = list(answers)
    for effect in sorted({reading.effect for own in read for reading in own}):
        having = {j: reading for j, own in enumerate(read) for reading in own if reading.effect == effect}
        certain = {j for j, reading in having.items() if reading.beyond > NORMAL}
        rare = len(answers) > 1 and len(certain) <= MOST_JOINTS * len(answers)
        for j, reading in having.items():
            share = expected_share(answers[j].model, len(certain - {j}), len(answers) - 1)
            says = float(norm.cdf(reading.beyond / (OVERSTATED**0.5 if rare else 1.0)))
            probability = share * says / (share * says + (1.0 - share) * (1.0 - says))
            if probability > BELIEVED:
                answers[j] = _with(answers[j], reading, probability)
    return answers


def _with(joint: JointFound, reading: Reading, probability: float) -> JointFound:
    return replace(
        joint,
        causes=(*joint.causes, JointCause(reading.effect, probability, (reading.number,))),
        without={**joint.without, reading.effect: reading.without},
        probabilities={**joint.probabilities, reading.effect: probability},
    )


def _deviation(search: Search, known: Known, at: int) -> float:
    """Standard deviation of the logarithm of an implied number, from all that makes the numbers of its set uncertain.

    Args:
        at: which of those that are implied.
    """
    values, free = known.solution.values, known.solution.free

    def logarithm(moved: np.ndarray) -> float:
        told = search.model.implied(moved)
        return float(np.log(told[at].value)) if len(told) > at else np.nan

    slopes = np.zeros(len(free))
    for k, place in enumerate(free):
        step, moved = _STEP * max(abs(float(values[place])), 1e-12), values.copy()
        step = -step if values[place] + step > search.fitter.high[place] else step
        moved[place] += step
        slopes[k] = (logarithm(moved) - logarithm(values)) / step
    rank_beside(search, known)
    variance = float(slopes @ normal_covariance(search, known) @ slopes)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance > 0.0 else np.inf


def _limited(search: Search, known: Known) -> Fitted:
    """A set with a law that keeps what is implied within what a sound machine has."""
    model, solution = search.model.limited(), known.solution
    solution = Fitter(model).fit(solution.free, [solution.values], known.covariance.noise)
    return fitted(search, replace(known, solution=solution), model)


def _bears_out(named: Fitted, without: Fitted) -> bool:
    """Whether the held-out trials do not speak against it."""
    return float(without.heldout @ without.heldout) >= float(named.heldout @ named.heldout)
