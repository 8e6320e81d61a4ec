"""The answer for one joint: probabilities of the effects, their numbers, what is left without each of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hqpipe.identify.beside import rank_beside
from hqpipe.identify.drifts import drifts
from hqpipe.identify.found import Fitted, JointCause, JointFound, Number
from hqpipe.identify.intervals import half_widths
from hqpipe.identify.misfit import misfit, misfit_noise
from hqpipe.identify.search import HALVED, LEAST_GAIN, Known, Names, Search
from hqpipe.identify.uncertain_effects import certainty, without_uncertain

LEAST_SHARE = 0.01
"""Square of what a cause does to the prediction, over the squared gap from the base's error to the noise: a tenth of the gap.
What does less refines the law of another cause. It is not asked to close that share by itself: of a delay and a lag of like
size either one can take most of the other's part. Of the held-out errors it is the share that a cause must close. The cost: a
real effect that small beside a large one is not named."""
LEAST_SIZE = 0.1
"""Size over what a data sheet of such a machine would give, below which a cause has to close `LEAST_SHARE` of the squared gap
beside the others; assumption: a gain unequal by 1 % where 10 % are usual is none if it does no more than refine another law."""
BORNE_OUT = 0.25
"""Of the square of what a cause does to the prediction of the held-out trials, that it must take off their squared error. One
that has the fitted size there takes off all of it, one that is not there adds as much. Seen: 0.66 and more for 316 causes that
were there, 0.2 and less for four of five that were not. The cost: a cause of few joints that is less than five eighths as large
in these trials as in the others."""
BELIEVED = 0.5  # probability from which an effect, or one of those that are like it, is more likely there than not
CONFUSED = 0.05  # probability of a set with another effect instead, from which both are said to be alike; assumption


def answer(search: Search, best: Known) -> JointFound:
    """What a finished search says of its joint.

    Args:
        best: the set that it reached.
    """
    while True:
        best = without_uncertain(search, best)
        base = _context(search, best)
        core, found = _with_beliefs(search, best, base)
        uncertain = {name for name in found if certainty(search, core, name) <= 1.0}
        if not uncertain:
            break
        search.refused |= uncertain
        best = search.improved(search.grown(_only(search, core, core.names - uncertain)))
    rank_beside(search, core)
    probabilities = _considered(search, {name: belief.probability for name, belief in found.items()})
    claimed, core = core, _confirmed(search, core, base)
    unchanged = frozenset(name for name in core.names if search.effects[name].in_both)
    named = _only(search, core, frozenset(_causes(search, core, base)) | base.names | unchanged)
    without = {name: search.without(named, name) for name in _causes(search, named, base)}
    causes = sorted(without, key=lambda name: -without[name].solution.square)
    unshaped = _only(search, claimed, frozenset(_causes(search, claimed, base)) | base.names | unchanged)
    half = half_widths(search, core)
    whole, square = max(search.left_out(base), np.finfo(float).tiny), search.left_out(claimed)
    return JointFound(
        model=search.model,
        base=fitted(search, base),
        named=fitted(search, named),
        kept=fitted(search, core),
        full=fitted(search, min(best, core, key=lambda known: known.solution.square)),
        causes=tuple(
            JointCause(n, found[n].sure, _numbers(search, core, half, n), found[n].alike, found[n].odds) for n in causes
        ),
        without={name: fitted(search, without[name]) for name in causes},
        probabilities=probabilities,
        gains=dict(search.gains),
        shapes=_shapes(search, core, named),
        closes={n: (search.left_out(search.without(claimed, n)) - square) / whole for n in causes},
        unexplained=max(square - floor_of(search), 0.0) / whole,
        unknown=max(search.left_out(unshaped) - floor_of(search), 0.0) / whole,
        drifts=drifts(search, core),
        withdrawn=tuple(sorted(claimed.names - core.names)),
        minor=tuple(sorted(search.barred)),
    )


@dataclass(frozen=True, eq=False)
class _Belief:
    """In an effect of a set.

    Attributes:
        probability: that it is there, beside the sets without it or with another in its place. there: that it or one of these
            others is. sure: the probability if all joints had the name of a rival that is as good: that they all have the same
            name does not say which. alike: names of those that are as likely, or as good. odds: of each of these against it,
            under the same condition. rival: the most probable set with another one that may take its place; None without any.
            most: its probability.
    """

    probability: float
    there: float
    sure: float
    alike: tuple[str, ...]
    odds: tuple[float, ...]
    rival: Known | None
    most: float


def _with_beliefs(search: Search, best: Known, base: Known) -> tuple[Known, dict[str, _Belief]]:
    """What is worth keeping of a set, with each cause the most probable in its place, and how far each of them is believed."""
    core, exchanged = _worth_keeping(search, best, base), {best.names}
    while True:
        found = {name: _believed(search, core, name) for name in _causes(search, core, base)}
        likelier = [b for b in found.values() if b.most > b.probability and b.rival.names not in exchanged]
        doubtful = {name: belief.there for name, belief in found.items() if belief.there <= BELIEVED}
        if likelier:
            known = max(likelier, key=lambda belief: belief.most).rival
            exchanged.add(known.names)
        elif doubtful:
            known = search.without(core, min(doubtful, key=lambda name: doubtful[name]))
        else:
            return core, found
        core = _worth_keeping(search, known, base)


def _context(search: Search, best: Known) -> Known:
    """What the rest of the machine does to the joint, and what every sound one has of some effect, if data left out of the fit
    and the held-out trials bear it out."""

    def is_ordinary(known: Known, name: str) -> bool:
        return 0.0 < search.size(known, name) < search.effects[name].parameters[0].least

    ordinary = {name for name in best.names if is_ordinary(best, name)}
    context = _only(search, best, frozenset(n for n in best.names if search.effects[n].context) | ordinary)
    # Without the causes such an effect may grow, and stand for a part of the gap.
    context = _only(search, context, context.names - {n for n in ordinary if not is_ordinary(context, n)})
    plain = search.base
    better = search.left_out(context) < search.left_out(plain)
    return context if better and _heldout_square(search, context) <= _heldout_square(search, plain) else plain


def _causes(search: Search, known: Known, base: Known) -> list[str]:
    """The named effects of a set beside the context."""
    return sorted(name for name in known.names - base.names if search.effects[name].named)


def _worth_keeping(search: Search, known: Known, base: Known) -> Known:
    """The set without what closes too little of the error or does too little beside the gap; what is left is then exchanged
    where another set of as few is more probable.

    What counts is the error on groups of fit samples, each predicted from the others. An effect that most joints of the machine
    have need only not make it worse.

    Args:
        known: a set that the logs ask for. base: the context alone.
    """
    seen = {known.names}
    while True:
        known = _without_small(search, known, base)
        better = search.improved(known)
        if better.names == known.names:
            better = _likelier(search, known, base)
        if better.names in seen:
            break
        seen.add(better.names)
        known = better
    persistence = float(np.sum((search.model.fit.held - search.model.fit.output) ** 2))
    # What predicts no better than holding the output, and leaves most of the gap, explains nothing.
    return known if search.left_out(known) < max(persistence, HALVED * search.left_out(base)) else base


def _likelier(search: Search, known: Known, base: Known) -> Known:
    """The most probable of the sets of as few effects that were fitted and of which nothing is too small: the search passed it
    over for one with effects that were too small."""
    options = [k for k in search.known.values() if base.names <= k.names and len(k.names) <= len(known.names)]
    options = [k for k in options if k is not known and search.may_have(k.names) and search.likelier(k, known)]
    for option in sorted(options, key=lambda k: (-search.preference(k, known), sorted(k.names))):
        if _without_small(search, option, base).names == option.names:
            return search.known[option.names]
    return known


def _without_small(search: Search, known: Known, base: Known) -> Known:
    """The set without what is too small, the least first; arguments as of `_worth_keeping`."""
    least = LEAST_SHARE * max(search.left_out(base) - floor_of(search), 0.0)
    while rest := sorted(known.names - base.names):
        known, smaller = search.taken_apart(known, rest)
        square = search.left_out(known)
        closes = {name: search.left_out(smaller[name]) - square for name in rest}
        large = {name: _is_large(search, known, name, least, closes[name]) for name in rest}
        name = min(rest, key=lambda name: (large[name], name in search.shared and closes[name] >= 0.0, closes[name]))
        needed = 0.0 if name in search.shared else search.needed(square)
        if closes[name] >= needed and large[name]:
            break
        known = search.without(known, name)
    return known


def _is_large(search: Search, known: Known, name: str, least: float, closes: float) -> bool:
    """Whether an effect has the size of a cause; what both of two records have is part of the machine and needs no size.

    Args:
        least: square of what it must do to the prediction. closes: what it closes of the squared error beside the others, which
            speaks for one that is smaller than a data sheet would mention.
    """
    if search.effects[name].in_both:
        return True
    if not _is_admitted(search, known, name) or search.screening.does(known, name) < least:
        return False
    usual = search.fitter.spread[search.screening.places(name)[0]] if search.effects[name].named else np.inf
    return closes >= least or not np.isfinite(usual) or search.size(known, name) >= LEAST_SIZE * usual


def _is_admitted(search: Search, known: Known, name: str) -> bool:
    """Whether an effect is larger than every sound machine may have it, and not at its bound."""
    least = search.effects[name].parameters[0].least
    return search.size(known, name) >= least and search.within_bounds(known, name)


def floor_of(search: Search) -> float:
    """Squared error that the noise of the sensors leaves on the fit samples."""
    return len(search.model.fit.trial) * misfit_noise(search.model)[0] ** 2


def _confirmed(search: Search, known: Known, base: Known) -> Known:
    """The set without causes that do not show in the held-out trials: a claim that they do not bear out is withdrawn, and with
    it what has no size without it.

    It has to close a share of their error, and `BORNE_OUT` of what it does to their prediction: a term that fits what the fit
    trials have by chance does as much to others, and closes little. They choose nothing else, and what is left is never made
    to look better by it.
    """
    if not len(search.model.heldout.trial):
        return known
    floor = len(search.model.heldout.trial) * misfit_noise(search.model)[1] ** 2
    without_any = _heldout_square(search, base)
    least = LEAST_SHARE * max(without_any - floor, 0.0)
    while causes := _causes(search, known, base):
        closes, shown = {}, {}
        known, smaller = search.taken_apart(known, causes)
        with_all = _heldout_square(search, known)
        for name in causes:
            closes[name] = _heldout_square(search, smaller[name]) - with_all
            # What errs more than the base in all trials together is rejected even if it does well in most of them.
            usual = _usual_gain(search, smaller[name], known) if with_all < without_any else -1.0
            borne_out = closes[name] > least or usual > LEAST_SHARE
            borne_out &= _closed_of_done(search, smaller[name], known) >= BORNE_OUT
            if name in search.shared:
                borne_out |= closes[name] > 0.0 or usual > 0.0
            shown[name] = borne_out and _is_admitted(search, known, name)
        name = min(causes, key=lambda name: (shown[name], closes[name]))
        if shown[name]:
            break
        known = search.without(known, name)
    return known


def _usual_gain(search: Search, small: Known, large: Known) -> float:
    """Share by which the squared error of a held-out trial grows without an effect, the geometric mean over the trials.

    In a trial where the machine does what it never does in the fit trials the error may be larger than in all others together,
    and says nothing of a cause that shows in these.
    """
    trial = search.model.heldout.trial
    present = np.bincount(trial) > 0
    with np.errstate(over="ignore", invalid="ignore"):
        squares = [np.bincount(trial, _heldout_error(search, k) ** 2) for k in (small, large)]
    if not np.isfinite(squares).all():
        return -1.0
    small_squares, large_squares = (np.maximum(s[present], np.finfo(float).tiny) for s in squares)
    return float(np.expm1(np.mean(np.log(small_squares / large_squares))))


def _closed_of_done(search: Search, small: Known, large: Known) -> float:
    """What an effect takes off the squared error of the held-out trials, over the square of what it does to their prediction:
    of all together, or of the middle one, if that is more; see `_usual_gain` for why."""
    trial = search.model.heldout.trial
    with np.errstate(over="ignore", invalid="ignore"):
        without, error = _heldout_error(search, small), _heldout_error(search, large)
        closed, done = np.bincount(trial, without**2 - error**2), np.bincount(trial, (without - error) ** 2)
    if not (np.isfinite(closed).all() and np.isfinite(done).all() and done.any()):
        return -1.0
    return float(max(closed.sum() / done.sum(), np.median(closed[done > 0.0] / done[done > 0.0])))


def _heldout_error(search: Search, known: Known) -> np.ndarray:
    """(H,) of a set at the held-out samples."""
    return misfit(search.model, known.solution.values, True).copy()  # a model may use the array again


def _heldout_square(search: Search, known: Known) -> float:
    if not len(search.model.heldout.trial):
        return 0.0
    error = _heldout_error(search, known)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(error @ error)


def fitted(search: Search, known: Known) -> Fitted:
    """A set with its errors."""
    values = known.solution.values
    with np.errstate(over="ignore", invalid="ignore"):
        error, heldout = search.model.error(values).copy(), search.model.error(values, True)
    order = tuple(name for name in search.effects if name in known.names)
    return Fitted(order, values, error, heldout)


def _believed(search: Search, best: Known, name: str) -> _Belief:
    smaller = search.without(best, name)
    against, options, twins = {"": -search.gain(best, smaller)}, {}, set()
    for option in (*search.replaced(smaller, name), *search.with_given_up(smaller)):
        other = next(iter(option.names - smaller.names))
        against[other], options[other] = search.preference(option, best), option
        # With as many numbers, and errors as large, only what a data sheet says of their sizes tells the two apart; where the
        # errors differ by less than a cause has to close, what the law leaves out may do it.
        as_good = search.telling(option, best) > np.log(CONFUSED)
        as_good = as_good or search.left_out(option) <= (1.0 + LEAST_GAIN) * search.left_out(best)
        if search.effects[other].sizes == search.effects[name].sizes and as_good:
            twins.add(other)
    weights = {other: _odds(value) for other, value in against.items()}
    alone = {
        other: value - (search.odds[other] - search.odds[name] if other in twins else 0.0)
        for other, value in against.items()
    }
    total = 1.0 + sum(weights.values())
    alike = {other for other, weight in weights.items() if weight / total >= CONFUSED} | twins
    rivals = [other for other in options if other not in search.given_up]
    rival = max(rivals, key=lambda other: weights[other], default=None)
    told = tuple(o for o in weights if o in alike and o and search.effects[o].named)
    return _Belief(
        1.0 / total,
        1.0 - weights[""] / total,
        1.0 / (1.0 + sum(_odds(value) for value in alone.values())),
        told,
        tuple(_odds(alone[o]) for o in told),
        options.get(rival),
        weights.get(rival, 0.0) / total,
    )


def _odds(logarithm: float) -> float:
    return float(np.exp(min(logarithm, 700.0)))


def _only(search: Search, best: Known, names: Names) -> Known:
    """The best set without what is no cause."""
    known = best
    for name in sorted(best.names - names):
        known = search.without(known, name)
    return known


def _numbers(search: Search, best: Known, half: np.ndarray, name: str) -> tuple[Number, ...]:
    """The parameters of an effect, with intervals cut at the bounds.

    Args:
        half: (F,) of the intervals of the free parameters.
    """
    fitter, free, found = search.fitter, best.solution.free, []
    for index, parameter in zip(search.screening.places(name), search.effects[name].parameters, strict=True):
        reach, value = half[np.flatnonzero(free == index)[0]], float(best.solution.values[index])
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
