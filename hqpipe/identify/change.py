"""What changed between two records of one machine.

Both records are one log with one set of numbers. Each candidate is a deviation of the numbers in the later record, of an effect
or of the base, or an effect that both records have. The search begins with what the earlier record asks for by itself. The
numbers of an earlier model without logs stay where it put them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.identify.deviations import Deviation, InBoth, Multiplied
from hqpipe.identify.found import JointCause, JointFound, LayerFound
from hqpipe.identify.misfit import Measure, misfit, misfit_noise, prediction_error
from hqpipe.identify.model import (
    Effect,
    JointModel,
    LayerJoints,
    Parameter,
    Ratio,
    Samples,
    all_parameters,
    parameter_names,
    positions,
)

Searched = Callable[[Sequence[JointModel]], tuple[JointFound, ...]]


def changes_between(then: LayerJoints, now: LayerJoints, searched: Searched) -> LayerFound:
    """The answer for the later record, whose causes are what changed.

    Args:
        then, now: joints of both records in one layer. searched: the search over joint models.

    Raises:
        UsageError: a joint has no earlier record.
    """
    earlier = {model.joint: model for model in then.models}
    _require_known(now, earlier)
    before = searched([earlier[model.joint] for model in now.models])
    changed = []
    for found, model in zip(before, now.models, strict=True):
        both = Both(found.model, model)
        changed.append(
            Changed(both, positions(both, ()), both.counted_now(found.full.values), known=found.full.effects)
        )
    return LayerFound(now, tuple(_with_references(joint) for joint in searched(changed)))


@dataclass(frozen=True, eq=False)
class KnownJoint:
    """What an earlier model says of a joint.

    Attributes:
        values: (P,) of the parameters of the joint's model in the later record. known: (P,) whether the earlier model says it;
            a number of the base that it does not know is fitted. sd: (P,) standard deviations of what it says; 0 where it is
            taken as exact.
    """

    values: np.ndarray
    known: np.ndarray
    sd: np.ndarray


def changes_since(then: Mapping[str, KnownJoint], now: LayerJoints, searched: Searched) -> LayerFound:
    """The answer for logs beside an earlier model, whose causes are what changed.

    Args:
        then: joint → what the model says. now: joints of the logs. searched: the search over joint models.

    Raises:
        UsageError: the model lacks a joint.
    """
    _require_known(now, then)
    changed = []
    for model in now.models:
        known = then[model.joint]
        fitted = np.flatnonzero(~known.known[: len(model.base)])
        changed.append(Changed(Both(_WithoutSamples(model), model), fitted, known.values, known.sd))
    return LayerFound(now, tuple(_with_references(joint) for joint in searched(changed)))


def _require_known(now: LayerJoints, then: Mapping[str, object]) -> None:
    for model in now.models:
        if model.joint not in then:
            raise UsageError(
                f"the reference has no joint '{model.joint}'{near_match(model.joint, then)}",
                field=model.joint,
                fix="give a reference of the same machine",
            )


class _WithoutSamples:
    """The model of a joint without any sample: the place of an earlier record that is a model alone."""

    def __init__(self, model: JointModel) -> None:
        none = np.zeros(0)
        self.joint, self.unit, self.dt = model.joint, model.unit, model.dt
        self.base, self.effects, self.notes, self.noise = model.base, model.effects, (), model.noise
        self.fit = self.heldout = Samples((), np.zeros(0, dtype=np.int64), none, none, none, none, none)

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return np.zeros(0)


@dataclass(eq=False)
class Both:
    """Two records of a joint as one log; held out is the later one alone.

    The models of the two may differ: which effects a record shows depends on its motion. A model whose numbers refer to
    something of its own record, as to its mean position, offers `referred_to(values, other)`: the same joint as the model of
    the other record counts it. One in which both records share more than numbers offers `together(then)`, whose
    `error(then, now, heldout)` takes the place of the two errors.
    """

    then: JointModel
    now: JointModel
    joint: str = field(init=False)

    def __post_init__(self) -> None:
        now = self.now
        self.joint, self.unit, self.dt = now.joint, now.unit, now.dt
        self.base, self.effects, self.notes = now.base, now.effects, now.notes
        self.fit, self.heldout, self.noise = _joined(self.then.fit, now.fit), now.heldout, now.noise
        together = getattr(now, "together", None)
        self._together = together(self.then) if together is not None else None
        self.misfit_noise = misfit_noise(now)
        self._last: dict[Measure, tuple[np.ndarray, np.ndarray]] = {}

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return self.error_of(values, values, heldout)

    def misfit(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return self.error_of(values, values, heldout, misfit)

    def error_of(
        self, then: np.ndarray, now: np.ndarray, heldout: bool, measure: Measure = prediction_error
    ) -> np.ndarray:
        """Errors with numbers of its own for each record, or what of them counts."""
        if self._together is not None:
            return self._together.error(self._of_then(then), now, heldout)
        if heldout:
            return measure(self.now, now, True)
        return np.concatenate([self._then_error(then, measure), measure(self.now, now, False)])

    def _then_error(self, values: np.ndarray, measure: Measure) -> np.ndarray:
        """Of the earlier record; most of what is tried changes the numbers of the later one alone."""
        if not len(self.then.fit.time):
            return np.zeros(0)  # a model alone
        last = self._last.get(measure)
        if last is None or not np.array_equal(values, last[0]):
            last = self._last[measure] = values.copy(), np.array(measure(self.then, self._of_then(values), False))
        return last[1]

    def _of_then(self, values: np.ndarray) -> np.ndarray:
        """Numbers in the order of `now` as the model of the earlier record counts them; what that lacks is left out."""
        refer = getattr(self.now, "referred_to", None)
        if refer is not None:
            values = refer(values, self.then)
        places, sources, absent = self._matched
        found = self._neutral.copy()
        found[places] = np.where(values[sources] == absent, found[places], values[sources])
        return found

    def counted_now(self, values: np.ndarray) -> np.ndarray:
        """Numbers of the earlier record's model in the order of the later one's; what this lacks is left out."""
        refer = getattr(self.then, "referred_to", None)
        if refer is not None:
            values = refer(values, self.now)
        places, sources, _ = self._matched
        found = np.array([parameter.neutral for parameter in all_parameters(self.now)], dtype=np.float64)
        found[sources] = values[places]
        return found

    @cached_property
    def _neutral(self) -> np.ndarray:
        """(P,) of the parameters of `then`."""
        return np.array([parameter.neutral for parameter in all_parameters(self.then)], dtype=np.float64)

    @cached_property
    def _matched(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters that both models have, by name: places in `then`, places in `now`, and the number in `now` at which an
        effect is absent; NaN for the base."""
        here = {name: k for k, name in enumerate(parameter_names(self.now))}
        pairs = [(k, here[name]) for k, name in enumerate(parameter_names(self.then)) if name in here]
        places, sources = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        parameters = all_parameters(self.now)
        absent = [parameters[k].neutral if k >= len(self.now.base) else np.nan for k in sources]
        return places, sources, np.array(absent, dtype=np.float64)


class Changed:
    """Two records of a joint with common numbers, and deviations of the later one as effects."""

    def __init__(
        self,
        both: Both,
        fitted: np.ndarray,
        values: np.ndarray,
        sd: np.ndarray | None = None,
        known: Collection[str] = (),
    ) -> None:
        """
        Args:
            fitted: (S,) places of the common numbers that are fitted again. values: (P,) of all. sd: (P,) standard deviations
                of those that are not, where they are known. known: effects that the earlier record asks for by itself.
        """
        self.both = both
        self.sd = np.zeros(len(values)) if sd is None else sd
        self.joint, self.unit, self.dt, self.noise, self.notes = both.joint, both.unit, both.dt, both.noise, both.notes
        self.misfit_noise = both.misfit_noise
        self.fit, self.heldout = both.fit, both.heldout
        self._shared = fitted
        parameters = all_parameters(both)
        self._low, self._high = (np.array([getattr(p, end) for p in parameters]) for end in ("low", "high"))
        self.base = tuple(replace(parameters[i], neutral=float(values[i]), starts=()) for i in self._shared)
        # With the logs of both records an effect that both have is a candidate, which the base is without.
        self.values = values if not self._has_logs else _without_effects(values, len(both.base), parameters)
        self._moves = [move for move in self._candidates(parameters) if move.effect.parameters]
        self.effects = tuple(move.effect for move in self._moves)
        self.begin = self._beginning(values, known)

    @property
    def _has_logs(self) -> bool:
        return len(self.both.then.fit.trial) > 0

    def _beginning(self, values: np.ndarray, known: Collection[str]) -> tuple[frozenset[str], np.ndarray] | None:
        """Effects that both records are likely to have, and values of all parameters with them; None without any."""
        start = [parameter.neutral for parameter in all_parameters(self)]
        at, names = len(self.base), []
        for move in self._moves:
            count = len(move.effect.parameters)
            if isinstance(move, InBoth) and move.source in known:
                start[at : at + count] = values[move.places]
                names.append(move.effect.name)
            at += count
        return (frozenset(names), np.array(start)) if names else None

    def _candidates(self, parameters: Sequence[Parameter]) -> list[InBoth | Deviation | Multiplied]:
        found: list[InBoth | Deviation | Multiplied] = []
        names, now = [p.name for p in self.both.base], self.both.now
        ratios: dict[str, Ratio] = getattr(now, "ratios", {})
        found += [Multiplied(name, ratio, names) for name, ratio in ratios.items()]
        groups: dict[str, Sequence[str]] = getattr(now, "changes", {})
        for name, group in groups.items():
            places = [names.index(each) for each in group]
            found.append(Deviation(Effect(name, (), common=True), places, self.values, parameters))
        alone = (
            [] if ratios else [k for k, name in enumerate(names) if all(name not in group for group in groups.values())]
        )
        for k in alone:
            effect = Effect(f"change of {names[k]}", (), False, names[k])
            found.append(Deviation(effect, [k], self.values, parameters))
        for effect in self.both.effects:
            places = positions(self.both, [effect.name])[len(names) :]
            if self._has_logs:
                found.append(InBoth(effect, list(places)))
            found.append(Deviation(effect, list(places), self.values, parameters))
        return found

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return self.both.error_of(self.then_values(values), self.now_values(values), heldout)

    def misfit(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return self.both.error_of(self.then_values(values), self.now_values(values), heldout, misfit)

    def then_values(self, values: np.ndarray) -> np.ndarray:
        """(P,) numbers of the earlier record, in the order of the later one's model."""
        then = self.values.copy()
        then[self._shared] = values[: len(self._shared)]
        self._moved(then, values, True)
        return then

    def now_values(self, values: np.ndarray, besides: Sequence[str] = ()) -> np.ndarray:
        """(P,) numbers of the later record; besides: changes that are left out of them."""
        now = self.then_values(values)
        self._moved(now, values, False, besides)
        return now

    def _moved(self, found: np.ndarray, values: np.ndarray, in_both: bool, besides: Sequence[str] = ()) -> None:
        """Numbers with what both records, or the later one alone, have of the candidates; in place, within their bounds."""
        at = len(self._shared)
        for move in self._moves:
            count = len(move.effect.parameters)
            if move.in_both == in_both and move.effect.name not in besides:
                move.move(found, values[at : at + count])
            at += count
        np.clip(found, self._low, self._high, out=found)

    def unchanged(self, values: np.ndarray) -> np.ndarray:
        """Values with what both records have, and no change."""
        found = values.copy()
        at = len(self.base)
        for move in self._moves:
            count = len(move.effect.parameters)
            if not move.in_both:
                found[at : at + count] = [p.neutral for p in move.effect.parameters]
            at += count
        return found

    def before(self, effect: str, values: np.ndarray) -> np.ndarray:
        """Numbers of an effect in the earlier record; 1 for what is counted as a ratio to it."""
        move = next(move for move in self._moves if move.effect.name == effect)
        return np.ones(1) if isinstance(move, Multiplied) else self.then_values(values)[move.places]

    def referred(self, cause: JointCause, values: np.ndarray) -> JointCause:
        """A cause with the numbers of both records."""
        move = next(move for move in self._moves if move.effect.name == cause.effect)
        return move.referred(cause, self.then_values(values), self.sd)


def _without_effects(values: np.ndarray, base: int, parameters: Sequence[Parameter]) -> np.ndarray:
    """Values (P,) of which the first are of the base, those of all effects neutral."""
    return np.array([*values[:base], *(parameter.neutral for parameter in parameters[base:])], dtype=np.float64)


def _with_references(found: JointFound) -> JointFound:
    """The joint with the numbers of both records in its causes; its base has those of the earlier record throughout."""
    changed = found.model
    causes = tuple(changed.referred(cause, found.kept.values) for cause in found.causes)
    values = changed.unchanged(found.kept.values)
    base = replace(found.base, values=values, error=changed.error(values), heldout=changed.error(values, True))
    return replace(found, causes=causes, base=base)


def _joined(first: Samples, second: Samples) -> Samples:
    """Samples of both, one after the other."""
    arrays = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("time", "position", "velocity", "output", "held")
    }
    trial = np.concatenate([first.trial, second.trial + len(first.files)])
    return Samples((*first.files, *second.files), trial, **arrays)
