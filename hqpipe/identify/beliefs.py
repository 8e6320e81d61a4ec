"""How far each cause of a set is believed, beside the sets without it or with another effect in its place."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.identify.misfit import floor_of
from hqpipe.identify.search import Known, Names, Search
from hqpipe.identify.thresholds import CONFUSED, HALVED, OVERSTATED
from hqpipe.identify.worth_keeping import causes_of, with_small, worth_keeping

BELIEVED = 0.5  # probability from which an effect, or one of those that are like it, is more likely there than not


@dataclass(frozen=True, eq=False)
class Belief:
    """In an effect of a set.

    Attributes:
        probability: that it is there, beside the sets without it or with a rival in its place. there: that it or one of these
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


def with_beliefs(search: Search, best: Known, base: Known) -> tuple[Known, dict[str, Belief]]:
    """What is worth keeping of a set, with each cause the most probable in its place, and how far each of them is believed.

    Causes are compared beside what is too small for one: without it, the rival that takes a part of it would win.
    """
    exchanged = {best.names}
    core, small = worth_keeping(search, best, base)
    while True:
        whole = with_small(search, core, small)
        found = {name: _believed(search, whole, name, exchanged) for name in causes_of(search, core, base)}
        if whole is not core:  # one of the small effects may be what takes the place of a cause
            found = {name: _with_twins(search, core, name, belief) for name, belief in found.items()}
        open_ones = {name: belief for name, belief in found.items() if name not in search.as_others}
        likelier = [belief for belief in open_ones.values() if belief.most > belief.probability]
        doubtful = {name: belief.there for name, belief in open_ones.items() if belief.there <= BELIEVED}
        if likelier:
            known = max(likelier, key=lambda belief: belief.most).rival
            exchanged.add(known.names)
        elif doubtful:
            known = search.without(whole, min(doubtful, key=lambda name: doubtful[name]))
        else:
            return core, found
        core, small = worth_keeping(search, known, base)


def _believed(search: Search, best: Known, name: str, tried: Collection[Names]) -> Belief:
    """The belief in one effect of a set.

    Args:
        tried: sets of which nothing else was worth keeping than what is compared here: no rivals any more.
    """
    smaller = search.without(best, name)
    against, options, twins = {"": -search.gain(best, smaller, _overstated(search, name))}, {}, set()
    for option in (*search.rivals(smaller, name), *search.with_given_up(smaller)):
        other = next(iter(option.names - smaller.names))
        against[other], options[other] = search.preference(option, best, _overstated(search, name, other)), option
        if _is_twin(search, option, best):
            twins.add(other)
    weights = {other: _odds(value) for other, value in against.items()}
    # What is as good may have been more probable by itself, but says no more than the name that was given.
    alone = {o: min(v - _said_by_others(search, o, name), 0.0) if o in twins else v for o, v in against.items()}
    open_ones = [o for o in against if not o or options[o].names not in tried]
    every, total = (1.0 + sum(weights[o] for o in names) for names in (weights, open_ones))
    alike = {other for other, weight in weights.items() if weight / every >= CONFUSED} | twins
    rivals = [other for other in open_ones if other and other not in search.given_up]
    rival = max(rivals, key=lambda other: weights[other], default=None)
    told = tuple(o for o in weights if o in alike and o and search.effects[o].named)
    return Belief(
        1.0 / total,
        1.0 - weights[""] / every,
        1.0 / (1.0 + sum(_odds(alone[o]) for o in open_ones)),
        told,
        tuple(_odds(alone[o]) for o in told),
        options.get(rival),
        weights.get(rival, 0.0) / total,
    )


def _is_twin(search: Search, option: Known, best: Known) -> bool:
    """Whether a set with another effect in the place of one has as many numbers, and errors as large.

    Then only what a data sheet says of their sizes tells the two apart. What both leave above the noise is of unknown form, and
    may favour either one by as much as it is; but the other effect has to do most of what the first does.
    """
    (other,), (name,) = option.names - best.names, best.names - option.names
    if search.effects[other].sizes != search.effects[name].sizes:
        return False
    if search.telling(option, best, _overstated(search, name, other)) > np.log(CONFUSED):
        return True
    without = search.left_out(search.without(best, name)) - search.left_out(best)
    if search.left_out(option) - search.left_out(best) > HALVED * without:
        return False
    left, of_option = (max(search.left_out(known) - floor_of(search.model), 0.0) for known in (best, option))
    return left > HALVED * of_option


def _with_twins(search: Search, core: Known, name: str, belief: Belief) -> Belief:
    """A belief with those effects as well that err as little in the place of a cause where nothing small stands beside it."""
    smaller, alike = search.without(core, name), dict(zip(belief.alike, belief.odds, strict=True))
    for option in search.rivals(smaller, name):
        (other,) = option.names - smaller.names
        if search.effects[other].named and _is_twin(search, option, core):
            odds = search.preference(option, core, _overstated(search, name, other))
            odds -= _said_by_others(search, other, name)
            alike.setdefault(other, _odds(min(odds, 0.0)))
    return replace(belief, alike=tuple(alike), odds=tuple(alike.values()))


def _overstated(search: Search, name: str, other: str = "") -> float:
    """How many times more the errors seem to say than they do for a cause that few joints have, against nothing in its place or
    what most joints have."""
    return OVERSTATED if name in search.rare and (not other or other in search.shared) else 1.0


def _said_by_others(search: Search, other: str, name: str) -> float:
    """What the other joints say for one of two effects, ln of odds."""
    return search.odds[other] - search.odds[name]


def _odds(logarithm: float) -> float:
    return float(np.exp(min(logarithm, 700.0)))
