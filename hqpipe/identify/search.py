"""Which effects a joint has: forwards, with exchanges and removals, until no single change makes the logs more probable.

Every candidate is first screened by the slope of the error along it; the best ones are fitted together with all that is free
already. The held-out samples play no part.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.effect_band import effect_band, square_above
from hqpipe.identify.evidence import independence, log_bayes_factor, occam, settled_price
from hqpipe.identify.least_squares import Fitter, Solution
from hqpipe.identify.left_out import left_out_error
from hqpipe.identify.misfit import floor_of
from hqpipe.identify.model import Effect, JointModel, positions
from hqpipe.identify.sampling import covariance
from hqpipe.identify.screening import Known, Names, Screening
from hqpipe.identify.thresholds import LEAST_GAIN, LEAST_RISE, MATERIAL, STRONGER, USUAL_SIZE

REFITTED = 4  # of the screened candidates; assumption: the best one is among them, though a slope is no fit
_REPLACED = 2  # of the candidates, that are tried in the place of another effect, and as rivals of one; assumption
_POLISHED = 2  # starts of an effect from which it is fitted; assumption: one of them is near the best minimum
MOST_EFFECTS = 8  # effects in one joint; assumption: more cannot be told apart in one output
_LOWER = (
    1e-4  # share of the squared error by which another minimum is lower: fits end, and priors move them, within less
)
AT_BOUND = 0.99  # of the way to its bound, from which a number counts as being there; by the tolerance of a fit
_PROMISED = 0.2
"""Of what a fit takes off the squared error, that its slope promises at least: where less is promised than this share of what
is needed, only the best is fitted, and none in the place of another effect. A rival does this share of what the effect does.
Seen: in 98 % of the fits on which something hung a slope promised a quarter or more."""


@dataclass(eq=False)
class Search:
    """One joint.

    Attributes:
        odds: effect → ln of the prior odds that the joint has it.
        gains: effect → ln of how much more probable the logs are with it beside the set that is reached.
        known: every set that was fitted. barred: effects that no set may have from now on.
        refused: effects that were found at a bound or without a size, so that other sets have to do without them.
        given_up: effects that gave their place to another name: no set has them, but they are rivals.
        shared: effects that are causes in most joints of the machine, as far as that is known. rare: causes of this joint that
            are not, where the machine has several. as_others: effect → range of its first number, where the joint has it as
            the others do: a part of the law, which stays.
    """

    model: JointModel
    odds: Mapping[str, float]
    as_others: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fitter: Fitter = field(init=False)
    known: dict[Names, Known] = field(init=False, default_factory=dict)
    barred: set[str] = field(init=False, default_factory=set)
    refused: set[str] = field(init=False, default_factory=set)
    given_up: set[str] = field(init=False, default_factory=set)
    shared: frozenset[str] = field(init=False, default=frozenset())
    rare: frozenset[str] = field(init=False, default=frozenset())
    _left_out: dict[tuple[Names, float], np.ndarray] = field(init=False, default_factory=dict)
    _begun: set[tuple[Names, Names, float]] = field(init=False, default_factory=set)
    gains: dict[str, float] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        first = len(self.model.base)  # of the places of a set with one effect
        within = {int(positions(self.model, [name])[first]): ends for name, ends in self.as_others.items()}
        self.fitter = Fitter(self.model, within)
        self.effects: dict[str, Effect] = {effect.name: effect for effect in self.model.effects}
        self.screening = Screening(self.fitter, self.effects)
        names: Names = frozenset()
        self.known[names] = self._known(names, base_solution(self.fitter))

    @property
    def base(self) -> Known:
        return self.known[frozenset()]

    def may_have(self, names: Names) -> bool:
        """Whether the joint has these effects, and they may stand in one set."""
        return names <= self.effects.keys() and all(name in self.addable(names - {name}) for name in names)

    def begun_at(self, numbers: Mapping[str, np.ndarray]) -> Known:
        """A set, fitted from given numbers of its effects beside the base; of one with other parameters than these, from
        neutral."""
        names, start = frozenset(numbers), self.base.solution.values.copy()
        for name, values in numbers.items():
            if len(values) == len(self.screening.places(name)):
                start[self.screening.places(name)] = values
        return self.begun_from(names, start)

    def begun_from(self, names: Names, values: np.ndarray) -> Known:
        """A set, fitted from given values (P,)."""
        return self._kept(names, self._fit(names, [values], self.base.covariance.noise))

    def likelier(self, one: Known, other: Known) -> bool:
        """Whether a set is more probable than another."""
        return self.log_odds(one, other) > 0.0

    def log_odds(self, one: Known, other: Known) -> float:
        """ln of the posterior odds of a set against another; 0 against itself."""
        if one.names == other.names:
            return 0.0
        if one.names > other.names:
            return self.gain(one, other)
        return -self.gain(other, one) if one.names < other.names else self.preference(one, other)

    def within_bounds(self, known: Known, name: str) -> bool:
        """Whether an effect is not at its bound, nor beyond what there is by its model, where another law must be at work.

        What both of two records have, or the other joints, is part of the machine, and a generic shape has no limit.
        """
        if not self.effects[name].named or self.effects[name].in_both or name in self.as_others:
            return True
        if name in getattr(self.model, "beyond", lambda values: ())(known.solution.values):
            return False
        first, fitter = int(self.screening.places(name)[0]), self.fitter
        end = fitter.high[first] if known.solution.values[first] > fitter.neutral[first] else fitter.low[first]
        return self.size(known, name) <= AT_BOUND * abs(float(end - fitter.neutral[first]))

    def size(self, known: Known, name: str) -> float:
        """Of an effect's first number, from neutral."""
        first = int(self.screening.places(name)[0])
        return abs(float(known.solution.values[first] - self.fitter.neutral[first]))

    def settled(self, best: Known) -> Known:
        """The set with the best of its fits in which each effect joins last: where a fit begins may decide where it ends."""
        for name in sorted(best.names):
            smaller = self.without(best, name)
            if self._begins(best.names, smaller):
                best = self._kept(best.names, self._refit(smaller, name))
        return best

    def improved(self, best: Known) -> Known:
        """Drop what is not needed, and exchange single effects while that helps; what ends at its bound is refused, and the set
        is completed without it, for what it closes may be the part of another effect, which it kept out."""
        while True:
            passed = [best.names]
            while (better := self._better(best, passed)) is not None and better.names not in passed:
                passed.append(better.names)
                best = better
            best = self.known[best.names]
            odd = [name for name in sorted(best.names) if not self.within_bounds(best, name)]
            if not odd:
                return best
            self.refused.update(odd)
            for name in odd:
                best = self.without(best, name)
            best = self.grown(best)

    def taken_apart(self, known: Known, names: Sequence[str]) -> tuple[Known, dict[str, Known]]:
        """A set, fitted again where a part of it turned out better, and the set without each of some of its effects."""
        while True:
            smaller = {name: self.without(known, name) for name in names}
            again = self._kept(known.names, known.solution)
            if again is known:
                return known, smaller
            known = again

    def grown_by(self, known: Known, name: str) -> Known:
        """The set with one more effect, started from the set."""
        names = known.names | {name}
        if names in self.known:
            return self._kept(names, self.known[names].solution)
        self._begins(names, known)
        return self._kept(names, self._refit(known, name))

    def grown_along(self, names: Sequence[str]) -> Known:
        """The base with effects joining in the order in which they promise most, those of them that may stand together."""
        known, open_ones = self.base, set(names)
        while ranked := self.screening.screened(known, sorted(open_ones.intersection(self.addable(known.names)))):
            known = self.grown_by(known, ranked[0][1])
            open_ones -= known.names
        return known

    def without(self, known: Known, name: str) -> Known:
        """The set without one of its effects: the best fit from the set itself, and from what was fitted before."""
        names = known.names - {name}
        if not self._begins(names, known):
            return self.known[names]
        start = known.solution.values.copy()
        start[self.screening.places(name)] = self.fitter.neutral[self.screening.places(name)]
        starts = [start]
        if names not in self.known:
            starts += [
                k.solution.values for k in self.known.values() if k.names < names and len(k.names) + 1 == len(names)
            ]
        return self._kept(names, self._fit(names, starts, known.covariance.noise, known.solution))

    def gain(self, large: Known, small: Known, overstated: float = 1.0) -> float:
        """ln of the posterior odds of a set against a part of it; overstated: see `log_bayes_factor`."""
        more = large.names - small.names
        odds = sum(self.odds[name] for name in sorted(more)) - self.price_of_settled(large, more)
        return log_bayes_factor(self.fitter, large.solution, large.covariance, small.solution, overstated) + odds

    def preference(self, one: Known, other: Known, overstated: float = 1.0) -> float:
        """ln of the posterior odds of a set against another that is no part of it; overstated: see `log_bayes_factor`."""
        return self.telling(one, other, overstated) + self._price(one) - self._price(other)

    def telling(self, one: Known, other: Known, overstated: float = 1.0) -> float:
        """What the errors of two sets say for the first of them, ln; both are judged by those of the better."""
        better = min(one, other, key=lambda k: k.solution.square)
        worth = 0.5 * better.counts / (overstated * better.covariance.noise)
        return worth * (other.solution.square - one.solution.square)

    @cached_property
    def material(self) -> float:
        """Squared error, over all fit samples together, of which a simulator notices nothing."""
        output = self.model.fit.output
        return len(output) * (MATERIAL * float(np.std(output))) ** 2 if len(output) else 0.0

    def in_reach(self, known: Known, square: float) -> float:
        """A squared error of a set without what is above the noise and faster than its effects act, which none could describe.

        Args:
            square: of the set, in the fit or on data left out of it.
        """
        change = self.base.solution.error - known.solution.error
        faster = square_above(known.solution.error, effect_band(change, self.model.fit), floor_of(self.model))
        return max(square - faster, 0.0)

    def needed(self, square: float, is_usual: bool) -> float:
        """What a cause has to close of the squared error.

        Args:
            square: what is left with it, of `in_reach`. is_usual: whether it is of usual size.
        """
        return max(LEAST_RISE * square / (STRONGER**2 if is_usual else 1.0), self.material)

    def is_usual(self, known: Known, name: str) -> bool:
        """Whether an effect of a set is as large as a data sheet would have it; a generic shape has no such size."""
        return self.effects[name].named and self.size(known, name) >= self.usual_size(name)

    def usual_size(self, name: str) -> float:
        """Of an effect's first number, from neutral; infinite where nobody knows."""
        return USUAL_SIZE * float(self.fitter.spread[self.screening.places(name)[0]])

    def left_out(self, known: Known) -> float:
        """Sum of the squares of `left_out_error`."""
        error = self.left_out_error(known)
        with np.errstate(over="ignore", invalid="ignore"):
            return float(error @ error)

    def left_out_error(self, known: Known) -> np.ndarray:
        """(N,) errors of groups of fit samples, each predicted from the others; see `hqpipe.identify.left_out`."""
        key = known.names, known.solution.square
        if key not in self._left_out:
            self._left_out[key] = left_out_error(self.fitter, known.solution)
        return self._left_out[key]

    def addable(self, names: Names) -> list[str]:
        """Effects that may join a set."""
        shut = names.union(*(self.effects[name].excludes for name in names)) if names else names
        shut = shut | self.barred | self.refused | self.given_up
        return [n for n, e in self.effects.items() if n not in shut and not e.excludes & names]

    def grown(self, best: Known) -> Known:
        """The set with the effects that the logs ask for beside it, the most probable first."""
        while len(best.names) < MOST_EFFECTS:
            larger = self.one_more(best)
            able = [k for name, k in larger.items() if self._closes_enough(k, best, name) or self.is_ordinary(k, name)]
            options = [(gain, k) for k in able if (gain := self.gain(k, best)) > 0.0]
            if not options:
                break
            _, best = max(options, key=lambda pair: pair[0])
        return best

    def one_more(self, best: Known) -> dict[str, Known]:
        """Effect → the set with it as well, for the one that promises most and those that promise what is asked for."""
        left = self.in_reach(best, best.solution.square)
        needed = max(LEAST_GAIN / (1.0 + LEAST_GAIN) * left, self.material)
        ranked = self.screening.screened(best, self.addable(best.names))[:REFITTED]
        tried = ranked[:1] + [(gain, name) for gain, name in ranked[1:] if gain >= _PROMISED * needed]
        return {name: self.grown_by(best, name) for _, name in tried}

    def _closes_enough(self, larger: Known, smaller: Known, name: str) -> bool:
        """Whether an effect that a set has beside a smaller one takes off what the search goes on for."""
        share = LEAST_GAIN / (STRONGER**2 if self.is_usual(larger, name) else 1.0)
        least = max(share * self.in_reach(larger, larger.solution.square), self.material)
        return smaller.solution.square - larger.solution.square >= least

    def is_ordinary(self, known: Known, name: str) -> bool:
        """Whether an effect of a set is of a size that every sound machine may have: a part of the law then, and no cause that
        would have to take off a share of the error."""
        return 0.0 < self.size(known, name) < self.sound_size(known, name)

    def sound_size(self, known: Known, name: str) -> float:
        """Of an effect's first number, that every sound machine may have beside the other numbers of a set."""
        sizes = getattr(self.model, "sound_sizes", lambda values: {})(known.solution.values)
        return max(self.effects[name].parameters[0].least, sizes.get(name, 0.0))

    def _better(self, best: Known, passed: Sequence[Names]) -> Known | None:
        """A more probable set with one effect less, or another one in its place.

        Args:
            passed: sets that led to this one. A set that lacks an effect has to be more probable than each of them: errors that
                grow from one removal to the next say ever less, and step by step would let everything go.
        """
        for name in sorted(best.names - self.as_others.keys()):
            smaller = self.without(best, name)
            best = self._kept(best.names, best.solution)
            larger = [self.known[names] for names in passed if names > smaller.names]
            if all(self.gain(known, smaller) <= 0.0 for known in (best, *larger)):
                return smaller
            for option in self.replaced(smaller, name):
                if self.preference(option, best) > 0.0:
                    return option
        return None

    def replaced(self, smaller: Known, name: str) -> list[Known]:
        """A set with another effect in the place of one that was taken out: each of those that promise most, and enough to
        replace it, or can do most of what it does, and of those that more joints of the machine have than not."""
        needed = smaller.solution.square - self.known[smaller.names | {name}].solution.square
        ranked = self.screening.screened(smaller, self._others(smaller, name))[:_REPLACED]
        likely = [other for gain, other in ranked if gain >= _PROMISED * needed]
        return self._with_one_of(smaller, dict.fromkeys((*likely, *self._alike(smaller, name))), name)

    def rivals(self, smaller: Known, *names: str) -> list[Known]:
        """A set with each of the effects that can do most of what those do that were taken out, and of those that more joints
        of the machine have than not. What the rest of the error promises says nothing of a rival."""
        return self._with_one_of(smaller, self._alike(smaller, *names), *names)

    def _alike(self, smaller: Known, *names: str) -> list[str]:
        """The effects that can do most of what those do that were taken out."""
        whole = self.known[smaller.names.union(names)]
        ranked = self.screening.in_place(whole, names, self._others(smaller, *names))
        return [other for share, other in ranked[:_REPLACED] if share >= _PROMISED]

    def _others(self, smaller: Known, *names: str) -> list[str]:
        """Effects that may join a set, without those that were taken out of it."""
        return [other for other in self.addable(smaller.names) if other not in names]

    def _with_one_of(self, smaller: Known, likely: Collection[str], *names: str) -> list[Known]:
        """A set with each of some effects, and of those that more joints have than not, in the place of others."""
        usual = [other for other in self._others(smaller, *names) if self.odds[other] > 0.0 and other not in likely]
        return [self.grown_by(smaller, other) for other in (*likely, *usual)]

    def with_given_up(self, smaller: Known) -> list[Known]:
        """A set with each of the effects that were given up and may stand beside it."""
        able = (name for name in sorted(self.given_up) if not self.effects[name].excludes & smaller.names)
        return [self.grown_by(smaller, name) for name in able]

    def price_of_settled(self, known: Known, names: Names) -> float:
        """ln of the price of what effects settle by themselves, see `settled_price`; known: a set, whose errors weigh it."""
        return settled_price(known.solution, self.model.fit, [self.effects[name].settled for name in sorted(names)])

    def _price(self, known: Known) -> float:
        odds = sum(self.odds[name] for name in sorted(known.names)) - self.price_of_settled(known, known.names)
        return known.freedom + odds

    def _fit(
        self, names: Names, starts: Sequence[np.ndarray], noise: float, origin: Solution | None = None
    ) -> Solution:
        known = self.known[names].solution if names in self.known else None
        known = known if known is not None and np.isfinite(known.square) else None
        return self.fitter.fit(positions(self.model, list(names)), starts, noise, origin, known)

    def _begins(self, names: Names, origin: Known) -> bool:
        """Whether a set is fitted from another one for the first time; a second fit would end where the first one did."""
        key = (names, origin.names, origin.solution.square)
        new = key not in self._begun
        self._begun.add(key)
        return new

    def _kept(self, names: Names, solution: Solution) -> Known:
        """A set with the better of a fit and of what is known of it; no worse than any part of it that is known."""
        if names not in self.known or solution.square < (1.0 - _LOWER) * self.known[names].solution.square:
            self.known[names] = self._known(names, solution)
        known = self.known[names]
        least = (1.0 - _LOWER) * known.solution.square
        parts = [k for k in self.known.values() if k.names < names and k.solution.square < least]
        if parts:
            part = min(parts, key=lambda k: k.solution.square)
            solution = self._fit(names, [part.solution.values], part.covariance.noise)
            if solution.square < known.solution.square:
                self.known[names] = self._known(names, solution)
        return self.known[names]

    def _known(self, names: Names, solution: Solution) -> Known:
        own, scatter = np.arange(len(self.model.base), len(solution.free)), covariance(self.fitter, solution)
        counts = independence(self.fitter, solution, scatter, own) if len(own) else 1.0
        return Known(names, solution, scatter, counts, occam(self.fitter, solution, scatter, own))

    def _refit(self, known: Known, name: str) -> Solution:
        """The best of the fits from the starts that promise most: delays, gaps and limits have several minima."""
        promises = self.screening.promises(known, name)[:_POLISHED]
        starts = [self.screening.start(known, promise) for promise in promises]
        return self._fit(
            known.names | {name}, starts or [known.solution.values], known.covariance.noise, known.solution
        )
