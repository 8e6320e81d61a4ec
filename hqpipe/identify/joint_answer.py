"""The answer for one joint: probabilities of the effects, their numbers, what is left without each of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.stats import t as student

from hqpipe.identify.drifts import drifts
from hqpipe.identify.found import Fitted, JointCause, JointFound, Number
from hqpipe.identify.sampling import correlation_time
from hqpipe.identify.search import Known, Names, Search

LEAST_GAIN = 0.05
"""Share by which the squared error must grow without an effect for it to be a cause: 2.5 % of the error. An effect with less is
of no use to a simulator. The cost: a real one that small is not named."""
BELIEVED = 0.5  # probability from which an effect is more likely there than not
CONFUSED = (
    0.05  # probability of a set with another effect in its place, from which the two are said to be alike; assumption
)


def answer(search: Search, best: Known) -> JointFound:
    """What a finished search says of its joint.

    Args:
        best: the set that it reached.
    """
    search.rank_beside(best)
    probabilities, alike, without = {}, {}, {}
    for name in sorted(best.names):
        probabilities[name], alike[name], without[name] = _probability(search, best, name)
    causes = [
        name
        for name in probabilities
        if search.effects[name].named and probabilities[name] > BELIEVED and _grows(without[name], best) >= LEAST_GAIN
    ]
    causes.sort(key=lambda name: -without[name].solution.square)
    named = _only(search, best, frozenset(causes))
    full = fitted(search, best)
    return JointFound(
        model=search.model,
        base=fitted(search, search.base),
        named=fitted(search, named),
        full=full,
        causes=tuple(JointCause(n, probabilities[n], _numbers(search, best, n), alike[n]) for n in causes),
        without={name: fitted(search, search.without(named, name)) for name in causes},
        probabilities=_considered(search, probabilities),
        gains=dict(search.gains),
        shapes=_shapes(search, best, named),
        independent=len(full.error) / correlation_time(full.error, search.model.fit),
        drifts=drifts(search, best),
    )


def fitted(search: Search, known: Known) -> Fitted:
    """A set with its errors."""
    heldout = search.model.error(known.solution.values, True)
    order = tuple(name for name in search.effects if name in known.names)
    return Fitted(order, known.solution.values, known.solution.error, heldout)


def _probability(search: Search, best: Known, name: str) -> tuple[float, tuple[str, ...], Known]:
    """Of an effect of the best set, beside the sets without it or with another in its place; the others; the set without it."""
    smaller = search.without(best, name)
    against = {"": -search.gain(best, smaller)}
    for option in search.replaced(smaller, name):
        other = next(iter(option.names - smaller.names))
        against[other] = search.preference(option, best)
    search.gains[name] = -against[""]
    weights = {other: float(np.exp(min(value, 700.0))) for other, value in against.items()}
    total = 1.0 + sum(weights.values())
    alike = tuple(o for o, w in weights.items() if o and search.effects[o].named and w / total >= CONFUSED)
    return 1.0 / total, alike, smaller


def _grows(without: Known, best: Known) -> float:
    return without.solution.square / max(best.solution.square, np.finfo(float).tiny) - 1.0


def _only(search: Search, best: Known, names: Names) -> Known:
    """The best set without what is no cause."""
    known = best
    for name in sorted(best.names - names):
        known = search.without(known, name)
    return known


def _numbers(search: Search, best: Known, name: str) -> tuple[Number, ...]:
    """The parameters of an effect, with intervals cut at the bounds."""
    fitter, free = search.fitter, best.solution.free
    freedom = max(best.covariance.blocks - len(free), 1)
    reach = float(student.ppf(0.975, freedom))
    found = []
    first = len(search.model.base)
    for effect in search.model.effects:
        if effect.name == name:
            for k, parameter in enumerate(effect.parameters):
                index = first + k
                place = int(np.flatnonzero(free == index)[0])
                half = reach * float(np.sqrt(max(best.covariance.robust[place, place], 0.0)))
                value = float(best.solution.values[index])
                low, high = max(value - half, fitter.low[index]), min(value + half, fitter.high[index])
                found.append(Number(parameter.name, parameter.unit, value, (float(low), float(high))))
        first += len(effect.parameters)
    return tuple(found)


def _considered(search: Search, probabilities: Mapping[str, float]) -> dict[str, float]:
    """Probability of every effect; of one that is not in the best set from its gain beside it."""
    gains = search.gains
    return {
        name: probabilities.get(name, float(1.0 / (1.0 + np.exp(min(-gains[name], 700.0))))) for name in search.effects
    }


def _shapes(search: Search, best: Known, named: Known) -> dict[str, float]:
    """Signal → share of the squared error with the causes alone that the generic shapes of that signal close."""
    shapes = sorted(name for name in best.names if not search.effects[name].named)
    left = named.solution.square
    found: dict[str, float] = {}
    known = best
    for name in shapes:
        smaller = search.without(known, name)
        share = max(smaller.solution.square - known.solution.square, 0.0) / max(left, np.finfo(float).tiny)
        signal = search.effects[name].signal
        found[signal] = found.get(signal, 0.0) + min(share, 1.0)
        known = smaller
    return found
