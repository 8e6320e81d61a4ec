"""One case against its answer: what was named, where, how large, and what was missed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from hqpipe.benchmark.score.truth import CHANGE, Answer, Gaps, TrueEffect, alone, must_be_named, shown

PARAMETER_TOLERANCE = 0.1  # the aim's
SAME_PLACE = 0.8  # share of the joints: two of twelve may be off, a leg or a kind of joint is exactly right
AS_GOOD = 1.05  # of the RMSE: noise and mismatch of the plant's sound machine move it by that much; assumption
_QUARTERS = 4  # regimes quarter_1 … quarter_4 of a trial
_NOTABLE = 0.5  # a place counts as said if its share is at least this part of the largest


def alternatives(cause: Mapping[str, Any]) -> frozenset[str]:
    """Names that the logs could not tell from this cause; sets of names are opened."""
    flat: set[str] = set()
    for entry in cause["confused_with"]:
        flat.update([entry] if isinstance(entry, str) else entry)
    return frozenset(flat)


def stands_for(cause: Mapping[str, Any], effect: str, strict: bool) -> bool:
    """Whether a cause names the effect, or (not strict) says that it cannot be told from it."""
    return cause["effect"] == effect or (not strict and effect in alternatives(cause))


@dataclass(frozen=True)
class Judged:
    """A case with its diagnosis.

    Attributes:
        answer: the truth. content: diagnosis.json, or None if the diagnosis failed. error: why it failed.
        gaps: base gaps of `hqpipe.benchmark.score.truth`. without: effects that the library lacked.
        left: joint → RMSE that is left with the causes in the model; empty if the program did not write it.
        library: effects that the diagnosis of such logs chooses from, those in `without` too; empty if that is not known.
    """

    answer: Answer
    content: Mapping[str, Any] | None
    error: str = ""
    gaps: Gaps | None = None
    without: tuple[str, ...] = ()
    left: Mapping[str, float] = field(default_factory=dict)
    library: frozenset[str] = frozenset()

    @cached_property
    def joints(self) -> frozenset[str]:
        """Of the logs, as far as the diagnosis or the gaps name them."""
        said = (self.content or {}).get("logs", {}).get("joints", ())
        return frozenset(said) or frozenset((self.gaps or {}).get("with", ())) - {"all"}

    @cached_property
    def causes(self) -> list[Mapping[str, Any]]:
        return list(self.content["causes"]) if self.content else []

    @property
    def verdict(self) -> str:
        return self.content["verdict"] if self.content else "failed"

    @property
    def namable(self) -> tuple[TrueEffect, ...]:
        """The effects that the library held."""
        return tuple(e for e in self.answer.effects if not e.outside and e.effect not in self.without)

    @property
    def sought(self) -> tuple[TrueEffect, ...]:
        """Those of them that the case is about."""
        return tuple(e for e in self.namable if not e.ordinary)

    @property
    def counted(self) -> tuple[TrueEffect, ...]:
        """Those, and what every such machine has as far as its own gap is known; the rest may be named and need not be."""
        return tuple(e for e in self.namable if not e.ordinary or alone(e.effect) in (self.gaps or {}))

    @property
    def needed(self) -> tuple[TrueEffect, ...]:
        """Those of the counted ones that make a gap which no integrator hides."""
        counted = ((effect, self.answer.as_it_shows(effect)) for effect in self.counted)
        return tuple(e for e, visible in counted if visible is not None and must_be_named(self.gaps, visible))

    @property
    def not_asked(self) -> frozenset[str]:
        """Names of the needed ones that a diagnosis of such logs does not choose from, as far as that is known."""
        return frozenset(e.effect for e in self.needed) - self.library if self.library else frozenset()

    @property
    def unnamable(self) -> bool:
        """Whether something is wrong that the library did not hold."""
        return len(self.sought) < len(self.answer.sought)

    def of(self, effect: TrueEffect, strict: bool = False) -> list[Mapping[str, Any]]:
        """The causes that stand for an effect, without those that name another one that is there."""
        others = self.answer.names - {effect.effect}
        return [c for c in self.causes if c["effect"] not in others and stands_for(c, effect.effect, strict)]

    def top_is_right(self, strict: bool = False) -> bool:
        ordinary = {e.effect for e in self.namable if e.ordinary} - {e.effect for e in self.sought}
        first = next((cause for cause in self.causes if cause["effect"] not in ordinary), None)
        return first is not None and any(stands_for(first, e.effect, strict) for e in self.sought)

    def alarms_rightly(self, strict: bool = False) -> bool:
        """Whether nothing is named that is not there; strictly, and no gap seen, unless for what every such machine has."""
        if self.content is None or self.false_names(strict):
            return False
        return not strict or bool(self.causes) or self.verdict == "no_gap"

    def false_names(self, strict: bool = False) -> list[str]:
        """Causes that stand for nothing that is wrong."""
        return [c["effect"] for c in self.causes if not any(stands_for(c, e.effect, strict) for e in self.namable)]

    def imitates(self, oracle: Judged) -> bool:
        """Whether every false name leaves its joints no worse off than the true effects do: such logs cannot refute it."""
        false = self.false_names()
        joints = {joint for c in self.causes if c["effect"] in false for joint in c["joints"]}
        known = self.left and oracle.left
        return bool(known) and all(self.left[j] <= AS_GOOD * oracle.left[j] for j in joints)

    def exact(self, strict: bool = False) -> bool:
        """Every effect named that makes a gap, and nothing else."""
        return (
            self.content is not None
            and not self.false_names(strict)
            and all(self.of(effect, strict) for effect in self.needed)
        )

    def admits_ignorance(self) -> bool:
        """The verdict `unknown` without a name; beside effects that are known, a remainder above the noise."""
        if self.content is None or self.false_names():
            return False
        if self.namable:
            return self.verdict == "unknown" or bool(self.content["unexplained"]["above_noise"])
        return self.verdict == "unknown"

    def place_is_right(self, strict: bool = False) -> bool | None:
        """Whether the joints (and for a time span the quarter) are right; None where nothing can be said.

        A named effect is where its causes are; joints in which it made no gap need not be named. An unknown one is where
        the largest places of `where` are: none of them in a sound joint; where it is in all joints, its place says
        nothing.
        """
        if not self.answer.effects or self.content is None:
            return None
        judged = [self._joints_right(e, strict) for e in self.counted if self.of(e, strict)]
        if any(not self._everywhere(e) for e in self.answer.sought if e not in self.namable):
            judged.append(self._unknown_right())
        judged += [self._quarter_right(e.span) for e in self.answer.effects if e.span]
        return all(judged) if judged else None

    def _everywhere(self, effect: TrueEffect) -> bool:
        return effect.scope == "machine" or set(effect.joints) == self.joints

    def _joints_right(self, effect: TrueEffect, strict: bool) -> bool:
        said = {joint for cause in self.of(effect, strict) for joint in cause["joints"]}
        visible = self.answer.as_it_shows(effect)
        needed = frozenset() if visible is None else shown(self.gaps, visible)
        wrong = (said - set(effect.joints)) | (needed - said)
        return not wrong if strict else len(wrong) <= (1.0 - SAME_PLACE) * len(said | needed)

    def _places(self) -> list[Mapping[str, Any]]:
        left = self.content["unexplained"]["where"] if self.namable else None
        return list(left or self.content["where"])

    def _unknown_right(self) -> bool:
        hidden = {j for e in self.answer.effects if e not in self.namable for j in e.joints}
        places = self._places()
        if not places:
            return False
        largest = max(place["share"] for place in places)
        return {p["joint"] for p in places if p["share"] >= _NOTABLE * largest} <= hidden

    def _quarter_right(self, span: Sequence[float]) -> bool:
        """Whether the first quarter of the trial that is listed overlaps the span."""
        for place in self.content["where"]:
            regime = str(place["regime"])
            if regime.startswith("quarter_"):
                start = (int(regime.removeprefix("quarter_")) - 1) / _QUARTERS
                return min(span[1], start + 1 / _QUARTERS) > max(span[0], start)
        return False

    def parameters(self) -> Iterator[dict[str, Any]]:
        """Every number that was claimed of an effect that is there, beside the true one; not for time spans."""
        for effect in self.namable:
            if effect.span:
                continue
            for cause in self.of(effect, strict=True):
                for name in (name for name in effect.parameters if name in cause["parameters"]):
                    true = effect.true_value(name, cause["joints"])
                    if true != 0.0:  # errors are relative
                        yield self._compare(effect, cause, name, true)

    def _compare(self, effect: TrueEffect, cause: Mapping[str, Any], name: str, true: float) -> dict[str, Any]:
        claim = cause["parameters"][name]
        then = (
            (claim.get("reference") or 0.0) if self.answer.kind == CHANGE else 0.0
        )  # a change's truth is what was added
        value, (low, high) = claim["value"] - then, (end - then for end in claim["ci95"])
        error = (value - true) / abs(true)
        return {
            "case": self.answer.case,
            "effect": effect.effect,
            "size": effect.size,
            "joints": list(cause["joints"]),
            "parameter": name,
            "true": true,
            "value": value,
            "ci95": [low, high],
            "error": error,
            "close": abs(error) <= PARAMETER_TOLERANCE,
            "covered": low <= true <= high,
        }

    def truth_text(self) -> str:
        """e.g. "valve_deadband (typical) in LFK + torque_bias"."""
        return " + ".join(_effect_text(e, self._everywhere(e)) for e in self.answer.effects) or "no effect"

    def answer_text(self) -> str:
        """e.g. "unknown: valve_lag 0.97 in LFK [or command_delay]"."""
        if self.content is None:
            return f"failed: {self.error}"
        named = [
            f"{c['effect']} {c['probability']:.2f} in {_joints_text(c['joints'], set(c['joints']) == self.joints)}"
            + (f" [or {', '.join(sorted(alternatives(c)))}]" if alternatives(c) else "")
            for c in self.causes
        ]
        return f"{self.verdict}: {' + '.join(named) if named else 'no cause named'}"


def _effect_text(effect: TrueEffect, everywhere: bool) -> str:
    span = f" from {effect.span[0]:.0%} to {effect.span[1]:.0%} of the trial" if effect.span else ""
    size = "ordinary" if effect.ordinary else effect.size if effect.factor is None else f"{effect.factor:.2f} × small"
    faulty = effect.faulty or effect.joints
    where = _joints_text(faulty, everywhere and set(faulty) == set(effect.joints))
    return f"{effect.effect}{f' ({size})' if size else ''} in {where}{span}"


def _joints_text(joints: Sequence[str], everywhere: bool) -> str:
    """Names of the joints; a machine of one joint has its name told."""
    return "all joints" if everywhere and len(joints) > 1 else ", ".join(joints)
