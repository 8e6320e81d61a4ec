"""What changed between two records of one machine.

Both records are one log with one set of numbers, and the effects that both ask for are part of it. Each candidate is then a
deviation of the numbers in the later record: of an effect, or of the base.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.identify.found import JointCause, JointFound, LayerFound
from hqpipe.identify.model import Effect, JointModel, LayerJoints, Parameter, Samples, all_parameters, positions

Searched = Callable[[Sequence[JointModel]], tuple[JointFound, ...]]


def changes_between(then: LayerJoints, now: LayerJoints, searched: Searched) -> LayerFound:
    """The answer for the later record, whose causes are what changed.

    Args:
        then, now: joints of both records in one layer. searched: the search over joint models.

    Raises:
        UsageError: a joint has no earlier record.
    """
    earlier = {model.joint: model for model in then.models}
    for model in now.models:
        if model.joint not in earlier:
            raise UsageError(
                f"the reference has no logs of joint '{model.joint}'{near_match(model.joint, earlier)}",
                field=model.joint,
                fix="give a reference of the same machine",
            )
    both = searched([Both(earlier[model.joint], model) for model in now.models])
    changed = searched([Changed(joint.model, joint.full.effects, joint.full.values) for joint in both])
    return LayerFound(now, tuple(_with_references(joint) for joint in changed))


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

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        return self.error_of(values, values, heldout)

    def error_of(self, then: np.ndarray, now: np.ndarray, heldout: bool) -> np.ndarray:
        """Errors with numbers of its own for each record."""
        if self._together is not None:
            return self._together.error(self._of_then(then), now, heldout)
        if heldout:
            return self.now.error(now, True)
        return np.concatenate([self.then.error(self._of_then(then)), self.now.error(now)])

    def _of_then(self, values: np.ndarray) -> np.ndarray:
        """Numbers in the order of `now` as the model of the earlier record counts them; what that lacks is left out."""
        refer = getattr(self.now, "referred_to", None)
        if refer is not None:
            values = refer(values, self.then)
        places, sources, absent = self._matched
        found = self._neutral.copy()
        found[places] = np.where(values[sources] == absent, found[places], values[sources])
        return found

    @cached_property
    def _neutral(self) -> np.ndarray:
        """(P,) of the parameters of `then`."""
        return np.array([parameter.neutral for parameter in all_parameters(self.then)], dtype=np.float64)

    @cached_property
    def _matched(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters that both models have, by name: places in `then`, places in `now`, and the number in `now` at which an
        effect is absent; NaN for the base."""
        here = {name: k for k, name in enumerate(_names(self.now))}
        pairs = [(k, here[name]) for k, name in enumerate(_names(self.then)) if name in here]
        places, sources = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        parameters = all_parameters(self.now)
        absent = [parameters[k].neutral if k >= len(self.now.base) else np.nan for k in sources]
        return places, sources, np.array(absent, dtype=np.float64)


class Changed:
    """Two records of a joint with common numbers, and deviations of the later one as effects."""

    def __init__(self, both: Both, common: Sequence[str], values: np.ndarray) -> None:
        self.both, self.values = both, values
        self.joint, self.unit, self.dt, self.noise, self.notes = both.joint, both.unit, both.dt, both.noise, both.notes
        self.fit, self.heldout = both.fit, both.heldout
        self._shared = positions(both, list(common))
        parameters = all_parameters(both)
        self.base = tuple(replace(parameters[i], neutral=float(values[i]), starts=()) for i in self._shared)
        self._moved: list[np.ndarray] = []
        self.effects = tuple(self._candidates(parameters))

    def _candidates(self, parameters: Sequence[Parameter]) -> list[Effect]:
        found = []
        groups: dict[str, Sequence[str]] = getattr(self.both.now, "changes", {})
        names = [p.name for p in self.both.base]
        grouped = {name for group in groups.values() for name in group}
        for name, group in groups.items():
            found.append(self._deviation(Effect(name, (), common=True), [names.index(g) for g in group], parameters))
        for k, name in enumerate(names):
            if name not in grouped:
                found.append(self._deviation(Effect(f"change of {name}", (), False, name), [k], parameters))
        for effect in self.both.effects:
            places = positions(self.both, [effect.name])[len(names) :]
            found.append(self._deviation(effect, list(places), parameters))
        return [effect for effect in found if effect.parameters]

    def _deviation(self, effect: Effect, places: list[int], parameters: Sequence[Parameter]) -> Effect:
        """Of some numbers in the later record; those that have no size of their own get a third of their value."""
        if places:
            self._moved.append(np.array(places, dtype=np.int64))
        moved = []
        for i in places:
            p, value = parameters[i], float(self.values[i])
            spread = p.spread if np.isfinite(p.spread) else max(abs(value) / 3.0, 1e-9)
            several = () if effect.parameters else tuple(np.clip([-spread, 0.0, spread], p.low - value, p.high - value))
            moved.append(replace(p, neutral=0.0, spread=spread, low=p.low - value, high=p.high - value, starts=several))
        return replace(effect, parameters=tuple(moved))

    def error(self, values: np.ndarray, heldout: bool = False) -> np.ndarray:
        then = self.values.copy()
        then[self._shared] = values[: len(self._shared)]
        now, at = then.copy(), len(self._shared)
        for places in self._moved:
            now[places] += values[at : at + len(places)]
            at += len(places)
        return self.both.error_of(then, now, heldout)

    def before(self, effect: str, values: np.ndarray) -> np.ndarray:
        """Numbers of an effect in the earlier record."""
        then = self.values.copy()
        then[self._shared] = values[: len(self._shared)]
        for candidate, places in zip(self.effects, self._moved, strict=True):
            if candidate.name == effect:
                return then[places]
        raise KeyError(effect)


def _with_references(found: JointFound) -> JointFound:
    """The joint with the numbers of both records in its causes; its base has those of the earlier record throughout."""
    changed = found.model
    causes = tuple(_with_reference(changed, cause, found.kept.values) for cause in found.causes)
    values = found.kept.values.copy()
    values[len(changed.base) :] = 0.0
    base = replace(found.base, values=values, error=changed.error(values), heldout=changed.error(values, True))
    return replace(found, causes=causes, base=base)


def _with_reference(changed: Changed, cause: JointCause, values: np.ndarray) -> JointCause:
    numbers = []
    for number, then in zip(cause.numbers, changed.before(cause.effect, values), strict=True):
        then = float(then)
        low, high = (then + end for end in number.ci95)
        numbers.append(replace(number, value=then + number.value, ci95=(low, high), reference=then))
    return replace(cause, numbers=tuple(numbers))


def _names(model: JointModel) -> list[tuple[str, str]]:
    """(effect, parameter) of all parameters in the order of the values; no effect for the base."""
    own = [("", parameter.name) for parameter in model.base]
    return own + [(effect.name, parameter.name) for effect in model.effects for parameter in effect.parameters]


def _joined(first: Samples, second: Samples) -> Samples:
    """Samples of both, one after the other."""
    arrays = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("time", "position", "velocity", "output", "held")
    }
    trial = np.concatenate([first.trial, second.trial + len(first.files)])
    return Samples((*first.files, *second.files), trial, **arrays)
