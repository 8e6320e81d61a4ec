"""Which set of effects explains one joint: all singles and pairs, then larger sets by growing and swapping.

The path is chosen on the fit trials; whether an effect is accepted is decided on the held-out ones. An effect
stays in the set only if leaving it out, with everything else fitted again, makes the held-out error worse by
more than chance (block bootstrap) and by a share that is worth a name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from hqpipe.gap.bootstrap import BLOCK_S
from hqpipe.gap.changes import CANDIDATES, columns, in_order
from hqpipe.gap.set_fit import JointFitter, Names, SetFit, is_poor

MOST_EFFECTS = 5  # per joint; more have never been told apart on logs of a minute; assumption
BEAM = 4  # sets that are grown side by side
PAIR_ITERATIONS, GROW_ITERATIONS = 6, 8
MATERIAL = 0.005  # of the output's RMS: a change of the error by less is no use to a simulator
WORTH = 1.10  # squared error without an effect over that with it: less is not worth a name
SHOWN = 0.1
"""Of that ratio's logarithm what the fit trials must show of an effect that always acts. In 74 cases looked into right
names show 0.3 of it or more, one that was not there 0.03."""
RIVAL = 0.03  # of an effect's improvement: another that comes as close cannot be told from it
RIVAL_Z, DOUBTFUL = 2.0, 0.25  # standard errors by which a rival must be worse, unless it is so by this share
TOLD = 2.0  # squared error with a rival over that with the name, from which an earlier record tells the two apart; assumption
SHAPE_WORTH = 1.005  # for every parameter beyond the first: of two effects that do alike the simpler one is named
NEAR, MOST_NEAR = 1.3, 4  # loss over the best one's, and number of sets that are compared once settled; assumptions
UNTOUCHED = 1e-3  # of the loss: a smaller change says that the fit trials do not care
SEARCH_WORTH = 1.05  # the same while growing: a weak effect may open the way for a strong one


@dataclass(frozen=True)
class Support:
    """What speaks for one effect of a set, from the held-out trials.

    Attributes:
        effect: name.
        ratio: mean squared error without it over that with it.
        z: mean of the improvement over its standard error, by blocks.
        shown: loss in the fit trials without it over that with it.
        rivals: effects that could stand in its place as well.
    """

    effect: str
    ratio: float
    z: float
    shown: float
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class JointResult:
    """The search of one joint.

    Attributes:
        joint: name.
        base: fit without effects.
        best: fit of the accepted set (the base fit if none).
        support: one per accepted effect.
        singles: every candidate alone.
        tried: number of sets fitted.
    """

    joint: str
    base: SetFit
    best: SetFit
    support: tuple[Support, ...]
    singles: dict[str, SetFit]
    tried: int = field(default=0)


class JointSearch:
    """Search of one joint.

    Args:
        fitter: of the joint.
        library: candidate effects.
        significance: z that an effect must exceed; corrected for the number of questions by the caller.
    """

    def __init__(self, fitter: JointFitter, library: Sequence[str], significance: float) -> None:
        self.fitter, self.library, self.significance = fitter, in_order(library), significance
        data = fitter.data
        self._block = max(1, round(BLOCK_S / (data.fit.signals.steps * data.row_dt)))
        self._tried: dict[Names, SetFit] = {}
        self._fine: set[Names] = set()

    def fit(self, names: Sequence[str], warm: Sequence[SetFit] = (), iterations: int = GROW_ITERATIONS) -> SetFit:
        """A set's fit, remembered; one that a part of it in `warm` shows to be poor is fitted again."""
        key = in_order(names)
        known = self._tried.get(key)
        if known is None or any(is_poor(known, part) for part in warm):
            self._tried[key] = self.fitter.fit(key, warm, iterations)
        return self._tried[key]

    @property
    def tried(self) -> list[SetFit]:
        """Every set that was fitted."""
        return list(self._tried.values())

    def run(self) -> JointResult:
        """All singles and pairs, larger sets, elimination."""
        base = self.fitter.fit(())
        self._tried[()] = base
        singles = {name: self.fitter.fit((name,)) for name in self.library}
        self._tried |= {(name,): fit for name, fit in singles.items()}
        for a, b in combinations(self.library, 2):
            first, second = singles[a], singles[b]
            self.fit((a, b), [first if first.loss <= second.loss else second], PAIR_ITERATIONS)
        best = self._grow()
        best = self.completed(self._settled(self._exchanged(best)))
        best = self._as_built(self._simplest(self.completed(self.eliminate(best))))
        return JointResult(self.fitter.data.joint, base, best, self.with_support(best), singles, len(self._tried))

    def _simplest(self, fit: SetFit) -> SetFit:
        """The set, or one of other effects and fewer numbers that explains as much: what a larger set adds to it must be worth
        a name, certain and shown by the fit trials, as must each of the larger set's effects beside the others."""
        near = [g for g in self._tried.values() if g.effects and len(g.effects) < len(fit.effects)]
        near = [g for g in near if len(g.free) <= len(fit.free) and g.loss < NEAR * fit.loss]
        for other in (self._refined(g) for g in sorted(near, key=self._score)[:MOST_NEAR]):
            more = [name for name in fit.effects if name not in other.effects]
            if not any(self.earns(fit, self.support(name, other, fit)) for name in more):
                return self._simplest(self.eliminate(other))
        return fit

    def _as_built(self, fit: SetFit) -> SetFit:
        """The set with what machines are built with in the place of effects that cannot be told from it."""
        for name in fit.effects:
            usual = CANDIDATES[name].stands_for
            if usual not in self.library or usual in fit.effects:
                continue
            without = self.without(fit, name)
            other = self._refined(self.fit((*without.effects, usual), [without]))
            if self._alike(other, fit, without)[0] and _is_built(other, usual):
                return self._as_built(self.eliminate(other))
        return fit

    def _settled(self, fit: SetFit) -> SetFit:
        """The set and those with one effect less, fitted until they settle: they decide what is accepted."""
        for name in fit.effects:
            less = self.without(fit, name)
            if less.effects:
                self._fine.add(less.effects)
                self._tried[less.effects] = self.fitter.refine(less, fit)
        return self._refined(fit)

    def _refined(self, fit: SetFit) -> SetFit:
        """The set, fitted until it settles."""
        if fit.effects and fit.effects not in self._fine:
            self._fine.add(fit.effects)
            self._tried[fit.effects] = self.fitter.refine(fit)
        return self._tried[fit.effects]

    def _exchanged(self, fit: SetFit) -> SetFit:
        """The best of the sets with one effect exchanged, after those that come near have settled: haste may mislead."""
        fit = self._refined(fit)
        while len(fit.effects) > 1:
            near = [g for g in self._tried.values() if len(g.effects) == len(set(g.effects) | set(fit.effects)) - 1]
            near = [g for g in near if len(g.effects) == len(fit.effects) and g.loss < NEAR * fit.loss]
            best = min([fit, *(self._refined(g) for g in sorted(near, key=self._score)[:MOST_NEAR])], key=self._score)
            if best is fit:
                break
            fit = best
        return fit

    def completed(self, fit: SetFit, kept: Collection[str] = ()) -> SetFit:
        """The set with what the fit trials show a little and the held-out ones much, as a limit that is rarely reached.

        Args:
            kept: effects that others speak for, so that the joint alone need not.
        """
        while len(fit.effects) < MOST_EFFECTS:
            more = [(name, self._added(fit, name)) for name in self.library if name not in fit.effects]
            worthy = [g for name, g in more if g.loss < fit.loss and self.earns(g, self.support(name, fit, g))]
            if not worthy:
                break
            grown = self.eliminate(self._settled(min(worthy, key=lambda g: g.error)), kept)
            if grown.error >= fit.error:
                break
            fit = grown
        return fit

    def _added(self, fit: SetFit, name: str) -> SetFit:
        """The set with one effect more; one that can lie idle is woken from all its starts."""
        grown = self.fit((*fit.effects, name), [fit])
        if CANDIDATES[name].parameters[0].inverse:
            woken = self.fitter.fit_awake(grown, name)
            if woken.loss < grown.loss:
                self._tried[grown.effects] = grown = woken
        return grown

    def _score(self, fit: SetFit) -> float:
        shape = len(fit.free) - len(self._tried[()].free) - len(fit.effects)
        price = np.log(SEARCH_WORTH) * len(fit.effects) + np.log(SHAPE_WORTH) * shape
        return float(np.log(fit.loss + 1e-300) + price)

    def _grow(self) -> SetFit:
        """Beam search with additions and swaps, by the penalised loss in the fit trials."""
        ranked = sorted(self._tried.values(), key=self._score)
        best = ranked[0]
        beam = ranked[:BEAM]
        while True:
            fresh = []
            for fit in beam:
                fresh += self._neighbours(fit)
            ranked = sorted({f.effects: f for f in [*beam, *fresh]}.values(), key=self._score)
            if self._score(ranked[0]) >= self._score(best) - 1e-9:
                return best
            best, beam = ranked[0], ranked[:BEAM]

    def _neighbours(self, fit: SetFit) -> list[SetFit]:
        """Sets with one effect more, or one exchanged (pairs are all known)."""
        found = []
        rest = [name for name in self.library if name not in fit.effects]
        if 2 <= len(fit.effects) < MOST_EFFECTS:
            found += [self.fit((*fit.effects, name), [fit]) for name in rest]
        if len(fit.effects) > 2:
            for out in fit.effects:
                kept = [name for name in fit.effects if name != out]
                found += [self.fit((*kept, name), [fit]) for name in rest]
        return found

    def gain(self, without: SetFit, fit: SetFit) -> tuple[float, float]:
        """Ratio of squared held-out errors, and z of the improvement by blocks of about half a second.

        The improvement is judged three times, by the mean squared error, by the mean of its logarithm and against the
        noise, and the clearest answer counts: the first misses effects that help everywhere a little, the second
        those that help rarely but much, and both those that a few windows show and the others cannot. A fit that runs away
        is no improvement; where the one without does, the windows are compared in which it does not.
        """
        if not np.isfinite(fit.error):
            return 0.0, -np.inf
        sound = np.isfinite(without.heldout)
        if not sound.any():
            return np.inf, -np.inf
        before, after = without.heldout[sound], fit.heldout[sound]
        plain = self._z(before - after)
        logarithmic = self._z(np.log((before + 1e-300) / (after + 1e-300)))
        z = max(plain, logarithmic, _against_noise(before - after, after))
        return without.error / max(fit.error, 1e-300), z

    def _z(self, difference: np.ndarray) -> float:
        edges = np.arange(0, len(difference), self._block)
        blocks = np.add.reduceat(difference, edges) / np.diff([*edges, len(difference)])
        if len(blocks) < 2:
            return 0.0
        return float(blocks.mean() / max(blocks.std(ddof=1) / np.sqrt(len(blocks)), 1e-300))

    def as_others(self, fit: SetFit, effect: str, value: float) -> SetFit:
        """The set with an effect whose first number begins where other joints have it: a limit that the fit trials never
        reach cannot be fitted to them, and the held-out ones may reach it.

        Args:
            value: in the fit's own form (one over it for an inverse number).
        """
        own = self.fit((*fit.effects, effect), [fit])
        there = self.fitter.fit_from(own, effect, value)
        if there.loss <= own.loss * (1.0 + UNTOUCHED):
            self._tried[there.effects] = there
        return self._tried[own.effects]

    def like(self, fit: SetFit, numbers: Mapping[int, float]) -> SetFit:
        """The set, fitted again from where these columns have these numbers if that leads to less.

        Args:
            numbers: column → what other joints have there.
        """
        there = self.fitter.fit_like(fit, numbers)
        if there.loss >= fit.loss * (1.0 - UNTOUCHED):
            return fit
        self._tried[there.effects] = there
        return there

    def without(self, fit: SetFit, effect: str) -> SetFit:
        """The set less one effect, fitted again."""
        return self.fit([name for name in fit.effects if name != effect], [fit])

    def eliminate(self, fit: SetFit, kept: Collection[str] = ()) -> SetFit:
        """Drop the weakest effect until every one that is left earns its place on the held-out trials, or is `kept`."""
        while fit.effects:
            support = [self.support(name, self.without(fit, name), fit) for name in fit.effects if name not in kept]
            weak = [s for s in support if not self.earns(fit, s)]
            if not weak:
                break
            fit = self.without(fit, min(weak, key=lambda s: s.ratio).effect)
        return fit

    def support(self, effect: str, without: SetFit, fit: SetFit) -> Support:
        """What speaks for an effect beside the fit without it; its rivals are another question."""
        return Support(effect, *self.gain(without, fit), without.loss / max(fit.loss, 1e-300))

    def earns(self, fit: SetFit, support: Support) -> bool:
        """Whether an effect is worth its name: certain, material, no trifle beside what is left, and in the fit trials, too."""
        if support.ratio < WORTH or support.z < self.significance:
            return False
        material = (support.ratio - 1.0) * fit.error >= (MATERIAL * self.fitter.data.output) ** 2
        idle = CANDIDATES[support.effect].parameters[0].inverse  # below a limit that the fit trials may not reach
        asked = SHOWN * np.log(support.ratio) if np.isfinite(support.ratio) and not idle else -np.inf
        return bool(material and np.log(support.shown) >= asked)

    def with_support(self, fit: SetFit) -> tuple[Support, ...]:
        """What speaks for each effect of a set, with its rivals."""
        return tuple(self._with_rivals(fit, self.support(name, self.without(fit, name), fit)) for name in fit.effects)

    def _with_rivals(self, fit: SetFit, support: Support) -> Support:
        """Add the effects that explain the held-out trials as well in the place of this one."""
        kept = [name for name in fit.effects if name != support.effect]
        without = self.without(fit, support.effect)
        rivals = []
        for name in self.library:
            if name not in fit.effects:
                other = self.fit((*kept, name), [without])
                alike, z = self._alike(other, fit, without)
                told = self.fitter.data.then is not None and z >= RIVAL_Z and other.error > TOLD * fit.error
                if alike and not told:
                    rivals.append(name)
        return replace(support, rivals=tuple(rivals))

    def _alike(self, other: SetFit, fit: SetFit, without: SetFit) -> tuple[bool, float]:
        """Whether the held-out trials cannot tell one effect from another, and z of the difference."""
        _, z = self.gain(other, fit)
        share = (other.error - fit.error) / max(without.error - fit.error, 1e-300)
        return share < RIVAL or (z < RIVAL_Z and share < DOUBTFUL), z


def _is_built(fit: SetFit, effect: str) -> bool:
    """Whether a number of an effect has the size that machines are built with."""
    numbers = zip(columns(effect), CANDIDATES[effect].parameters, strict=True)
    return any(p.built_from and abs(fit.row[column]) >= p.built_from for column, p in numbers)


def _against_noise(fall: np.ndarray, left: np.ndarray) -> float:
    """z of the fall of the windows' squared errors, if noise of one sign throughout each window were all there is.

    A window whose predictions differ by Δ has e² − (e − Δ)² = 2eΔ − Δ², so that noise of variance σ² moves it by 2σ|Δ|,
    and where the change is clear Δ² is the fall itself. A saturation that one jump shows has no scatter between blocks
    of time to be judged by.

    Args:
        fall: (W,) what each window's mean squared error falls by. left: (W,) what is left of it.
    """
    return float(fall.sum() / max(2.0 * np.sqrt(np.median(left) * np.abs(fall).sum()), 1e-300))
