"""The answer for one joint: probabilities of the effects, their numbers, what is left without each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from hqpipe.identify.beliefs import Belief, with_beliefs
from hqpipe.identify.beside import rank_beside
from hqpipe.identify.confirmed import confirmed, heldout_square
from hqpipe.identify.drifts import drifts
from hqpipe.identify.effect_band import EffectBand, effect_band
from hqpipe.identify.found import BesideUnknown, Fitted, JointCause, JointFound, Number
from hqpipe.identify.intervals import corrected
from hqpipe.identify.misfit import floor_of
from hqpipe.identify.model import JointModel
from hqpipe.identify.search import Known, Names, Search
from hqpipe.identify.thresholds import HALVED, LEAST_GAIN
from hqpipe.identify.uncertain_effects import certainty, replaces, without_uncertain
from hqpipe.identify.worth_keeping import causes_of, with_small


def answer(search: Search, best: Known) -> JointFound:
    """What a finished search says of its joint.

    Args:
        best: the set that it reached.
    """
    best, base, core, found = _certain(search, best)
    rank_beside(search, core)
    probabilities = _considered(search, {name: belief.probability for name, belief in found.items()})
    claimed, core = core, confirmed(search, core, base)
    named, unshaped = (_unshaped(search, known, base) for known in (core, claimed))
    without = {name: search.without(named, name) for name in causes_of(search, core, base) if name in found}
    causes = sorted(without, key=lambda name: -without[name].solution.square)
    (values, half), floor = corrected(search, core), floor_of(search.model)
    whole, square = max(search.left_out(base), np.finfo(float).tiny), search.left_out(claimed)
    known_law = [with_law_of_machine(search, known, best) for known in (claimed, unshaped)]
    beside_unknown = _beside_unknown(search, *known_law, base, causes)
    return JointFound(
        model=search.model,
        base=fitted(search, base),
        named=fitted(search, named),
        kept=fitted(search, core),
        full=fitted(search, min(best, core, key=lambda known: known.solution.square)),
        causes=tuple(
            JointCause(n, found[n].sure, _numbers(search, core, values, half, n), found[n].alike, found[n].odds)
            for n in causes
        ),
        without={name: fitted(search, without[name]) for name in causes},
        probabilities=probabilities,
        gains=dict(search.gains),
        shapes=_shapes(search, core, named),
        unexplained=max(square - floor, 0.0) / whole,
        beside_unknown=beside_unknown,
        drifts=drifts(search, core, base),
        withdrawn=tuple(sorted(claimed.names - core.names)),
        minor=tuple(sorted(search.barred)),
    )


def _certain(search: Search, best: Known) -> tuple[Known, Known, Known, dict[str, Belief]]:
    """The set that the search reached, the context, the set of causes and how far each is believed, once all of these can be
    told from none.

    Beside fewer effects errors are larger, and one that could be told from none may be so no more. What is refused for that
    comes back, once, where it can be told from none in the place of another effect: it is a rival of that one.
    """
    left: set[str] = set()
    returned: set[str] = set()
    while True:
        best = without_uncertain(search, best)
        base = _context(search, best)
        core, found = with_beliefs(search, best, base)
        uncertain = {name for name in found if certainty(search, core, name) <= 1.0}
        if uncertain:
            search.refused |= uncertain
            left |= uncertain
            best = search.improved(search.grown(_only(search, core, core.names - uncertain)))
            continue
        rivals = {name for name in left - returned if replaces(search, core, name)}
        if not rivals:
            return best, base, core, found
        search.refused -= rivals
        returned |= rivals


def _beside_unknown(
    search: Search, claimed: Known, unshaped: Known, base: Known, causes: Sequence[str]
) -> dict[str, BesideUnknown]:
    """What each cause closes, and what is left above the noise without generic shapes.

    Both at the frequencies at which the effects of the set act, or up to higher ones at which the cause closes something, where
    it is larger there: what a delay does beside a lag is faster than most of what both do.

    A curve without meaning can describe all that a cause does. Where the causes alone leave no more than a simulator would
    miss, they need no curve beside them, and count by what they close without.

    Args:
        claimed, unshaped: the set with and without its generic shapes, beside the law of the machine.
    """
    whole = max(search.left_out(base), np.finfo(float).tiny)
    band = effect_band(base.solution.error - unshaped.solution.error, search.model.fit)

    @cache
    def square(known: Known, within: EffectBand) -> float:
        return within.square(search.left_out_error(known))

    def above_noise(known: Known, within: EffectBand) -> float:
        return max(square(known, within) - floor_of(search.model) * within.share, 0.0)

    def beside(known: Known, name: str) -> BesideUnknown:
        smaller = search.without(known, name)
        own = effect_band(smaller.solution.error - known.solution.error, search.model.fit)
        found = [
            BesideUnknown((square(smaller, each) - square(known, each)) / whole, above_noise(unshaped, each) / whole)
            for each in (band, max(band, own, key=lambda one: one.highest))
        ]
        return max(found, key=lambda each: each.closes - HALVED * each.unknown)

    is_closed = above_noise(unshaped, band) <= LEAST_GAIN * above_noise(base, band)
    told_by = unshaped if is_closed else claimed
    return {name: beside(told_by if name in told_by.names else claimed, name) for name in causes}


def with_law_of_machine(search: Search, known: Known, best: Known) -> Known:
    """A set with what most joints have as a cause and this one asks for, though it does too little here for one: no unknown."""
    law = best.names & search.shared - known.names
    return with_small(
        search, known, {name: best.solution.values[search.screening.places(name)] for name in sorted(law)}
    )


def _context(search: Search, best: Known) -> Known:
    """What the rest of the machine does to the joint, and what every sound one has of some effect, if data left out of the fit
    and the held-out trials bear it out."""
    ordinary = {name for name in best.names if search.is_ordinary(best, name)}
    context = _only(search, best, frozenset(n for n in best.names if search.effects[n].context) | ordinary)
    # Without the causes such an effect may grow, and stand for a part of the gap.
    context = _only(search, context, context.names - {n for n in ordinary if not search.is_ordinary(context, n)})
    plain = search.base
    better = search.left_out(context) < search.left_out(plain)
    return context if better and heldout_square(search, context) <= heldout_square(search, plain) else plain


def _unshaped(search: Search, known: Known, base: Known) -> Known:
    """A set without its generic shapes, but for those of the context."""
    shapes = {name for name in known.names if not (search.effects[name].named or search.effects[name].in_both)}
    return _only(search, known, known.names - shapes | base.names)


def fitted(search: Search, known: Known, law: JointModel | None = None) -> Fitted:
    """A set with its errors; law: by which they are, None for that of the search."""
    values, model = known.solution.values, law or search.model
    with np.errstate(over="ignore", invalid="ignore"):
        error, heldout = model.error(values).copy(), model.error(values, True)
    order = tuple(name for name in search.effects if name in known.names)
    return Fitted(order, values, error, heldout)


def _only(search: Search, best: Known, names: Names) -> Known:
    """The best set without what is no cause."""
    known = best
    for name in sorted(best.names - names):
        known = search.without(known, name)
    return known


def _numbers(search: Search, best: Known, values: np.ndarray, half: np.ndarray, name: str) -> tuple[Number, ...]:
    """The parameters of an effect, with intervals cut at the bounds.

    Args:
        values: (P,) as they are told. half: (F,) of the intervals of the free parameters.
    """
    fitter, free, found = search.fitter, best.solution.free, []
    for index, parameter in zip(search.screening.places(name), search.effects[name].parameters, strict=True):
        reach, value = half[np.flatnonzero(free == index)[0]], float(values[index])
        low, high = max(value - reach, fitter.low[index]), min(value + reach, fitter.high[index])
        found.append(Number(parameter.name, parameter.unit, value, (float(low), float(high))))
    return tuple(found)


def _considered(search: Search, probabilities: Mapping[str, float]) -> dict[str, float]:
    """Probability of every effect; of one that is not in the best set from its gain beside it."""
    gains = search.gains
    return {
        name: probabilities.get(name, float(1.0 / (1.0 + np.exp(min(-gains[name], 700.0))))) for name in search.effects
    }


def _shapes(search: Search, best: Known, named: Known) -> dict[str, float]:
    """Signal → share of the squared error with the causes alone that the generic shapes of that signal close."""
    shapes = sorted(best.names - named.names)
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
