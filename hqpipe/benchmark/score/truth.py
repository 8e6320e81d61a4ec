"""What the cases of `hqpipe blind make` hide: the answers, and the gap of the machine without its effects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import LogError
from hqpipe.gap.residuals.joint_scale import joint_scale, pooled
from hqpipe.identify.free_run import WINDOW_S, free_run
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.logs.log_set import read_log_set

FORMAT = "hqpipe-blind/1"
ANSWERS = "answers.json"
_KEYS = ("case", "kind", "effects", "truth")
QUADRUPED = "quadruped"  # machine of the cases that name none
CHANGE = "change"  # kind of a case with earlier logs: only what changed since is a cause
SHOWN = 0.3  # assumption: a joint with a third of the effect of the worst one must be named, with less it may be
LEAST_RISE = 0.05  # assumption: an effect that alone raises no joint's gap by more need not be named
GAPLESS = {"torque_scale"}  # the model's coefficients take it up: there is no gap, and other channels show it
INTEGRATOR = "integral_action"
TAKEN_UP = {"position_bias", "torque_bias"}
"""Offsets of the reference plant that the integrator of a joint has taken up when the log begins. The plant's flow is linear in
opening and torque, and no integrator reaches its limit: what it holds then, which no log says, differs by as much, and nothing
else does."""

Gap = Mapping[str, float]
"""RMSE by joint in the unit of its output, and over "all", each joint's against its scale in the case."""
Gaps = Mapping[str, Gap]
"""`Gap` of the case ("with"), of its machine without effects ("all"), without one (`lacking`) and with one (`alone`)."""


def lacking(effect: str) -> str:
    """Name of the set without one effect."""
    return f"without_{effect}"


def alone(effect: str) -> str:
    """Name of the set with one effect only."""
    return f"only_{effect}"


@dataclass(frozen=True)
class TrueEffect:
    """One planted effect.

    Attributes:
        effect, layer, scope: as in diagnosis.json. joints: where. outside: not in the library.
        size: "small", "typical", "large" or None. span: start and end as shares of the trial, or None.
        parameters: those with a number in diagnosis.json. factor: size over the small one of a faint effect, else None.
        per_joint: joint → parameters, where joints differ. ordinary: every such machine has it, beside what the case is about.
        faulty: joints in which there is more of it than in a sound machine; empty if these are all of `joints`.
    """

    effect: str
    layer: str
    joints: tuple[str, ...]
    scope: str
    outside: bool
    size: str | None
    span: tuple[float, float] | None
    parameters: Mapping[str, float]
    factor: float | None = None
    per_joint: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    ordinary: bool = False
    faulty: tuple[str, ...] = ()

    def true_value(self, parameter: str, joints: Sequence[str]) -> float:
        """Of the joints that a cause names, their mean."""
        values = [self.per_joint[joint][parameter] for joint in joints if parameter in self.per_joint.get(joint, {})]
        return sum(values) / len(values) if values else self.parameters[parameter]


@dataclass(frozen=True)
class Answer:
    """What is wrong in one case.

    Attributes:
        effects: that were planted; of a case of kind `CHANGE` what was added since its earlier logs, in numbers too.
        truth: folders of its log sets without effects, "all" or by effect. machine: family of the machine, e.g. "servo".
        reference: folder of its earlier logs, which the diagnosis is given too; None without.
    """

    case: str
    kind: str
    effects: tuple[TrueEffect, ...]
    truth: Mapping[str, Any]
    machine: str = QUADRUPED
    reference: str | None = None

    @property
    def names(self) -> frozenset[str]:
        return frozenset(effect.effect for effect in self.effects)

    def as_it_shows(self, effect: TrueEffect) -> TrueEffect | None:
        """An effect without the joints in which an integrator hides it, see `TAKEN_UP`; None if that are all of them."""
        if self.machine != QUADRUPED or effect.effect not in TAKEN_UP:
            return effect
        hidden = {joint for other in self.effects if other.effect == INTEGRATOR for joint in other.joints}
        joints = tuple(joint for joint in effect.joints if joint not in hidden)
        faulty = tuple(joint for joint in effect.faulty if joint not in hidden)
        return replace(effect, joints=joints, faulty=faulty) if joints else None

    @property
    def sought(self) -> tuple[TrueEffect, ...]:
        """The effects that the case is about."""
        return tuple(effect for effect in self.effects if not effect.ordinary)


def read_answers(folder: Path) -> list[Answer]:
    """The answers beside the cases.

    Raises:
        LogError: absent, or not in this format.
    """
    path = Path(folder) / ANSWERS
    if not path.is_file():
        raise LogError(f"{path} does not exist; expected a folder that hqpipe blind make wrote")
    raw = json.loads(path.read_text(encoding="utf-8"))
    if raw.get("format") != FORMAT:
        raise LogError(f"{path}: format is '{raw.get('format')}', expected {FORMAT}; make the cases again")
    for number, entry in enumerate(raw["answers"]):
        if missing := [key for key in _KEYS if key not in entry]:
            raise LogError(f"{path}: answers[{number}] has no '{missing[0]}'; make the cases again")
        if entry["kind"] == CHANGE and not entry.get("reference"):
            raise LogError(f"{path}: answers[{number}] is a change without 'reference'; make the cases again")
    machine = raw.get("machine", QUADRUPED)
    return [_answer(entry, entry.get("family", machine)) for entry in raw["answers"]]


def _answer(entry: Mapping[str, Any], machine: str) -> Answer:
    effects = tuple(
        TrueEffect(
            effect["effect"],
            effect["layer"],
            tuple(effect["joints"]),
            effect["scope"],
            effect["outside"],
            effect["size"],
            tuple(effect["span"]) if effect["span"] else None,
            _numbers(effect["parameters"]),
            effect.get("factor"),
            {joint: _numbers(values) for joint, values in effect.get("per_joint", {}).items()},
            effect.get("ordinary", False),
            tuple(effect.get("faulty_joints", ())),
        )
        for effect in entry["effects"]
    )
    return Answer(entry["case"], entry["kind"], effects, entry["truth"], machine, entry.get("reference"))


def _numbers(parameters: Mapping[str, float | None]) -> dict[str, float]:
    return {name: value for name, value in parameters.items() if value is not None}


def scales(folder: Path) -> dict[str, float]:
    """Joint → what its errors count against, N·m, as in a diagnosis of the log set."""
    log_set = read_log_set(folder)
    torques = [trial.trajectory.effort for trial in log_set.fit]
    return {joint: joint_scale([t[:, j] for t in torques]) for j, joint in enumerate(log_set.joints)}


def base_gap(folder: Path, scale: Mapping[str, float]) -> Gap:
    """Held-out free-running error of the paper's four coefficients, fitted to the fit trials of a log set.

    Args:
        scale: joint → N·m, of the case, for all sets that are compared with it.

    Returns:
        RMSE over the held-out samples in windows of 100 ms of each joint by its name, N·m, and over "all" joints, each over its
        scale.
    """
    log_set = read_log_set(folder)
    model = fit_actuator(log_set, window_s=WINDOW_S).model
    residuals = [free_run(t.trajectory, model, WINDOW_S) - t.trajectory.effort for t in log_set.heldout]
    square = np.mean(np.concatenate(residuals) ** 2, axis=0)
    joints = {joint: float(np.sqrt(value)) for joint, value in zip(log_set.joints, square, strict=True)}
    return {"all": pooled(square, np.array([scale[joint] for joint in log_set.joints])), **joints}


def true_shrink(gaps: Gaps) -> float | None:
    """How far the gap falls without any effect, None for a case without effects."""
    return _closed(gaps, "all") if "all" in gaps else None


def extra_error(gaps: Gaps | None) -> float | None:
    """What the effects add to the gap, in squares, over the gap of the machine without them; None if not known.

    sqrt(with² − without²)/without: proportional to a small effect, where the rise of the gap goes with its square. 0
    where the gap does not rise.
    """
    if not gaps or "all" not in gaps:
        return None
    ratio = gaps["with"]["all"] / gaps["all"]["all"]
    return max(ratio**2 - 1.0, 0.0) ** 0.5


def _closed(gaps: Gaps, name: str) -> float:
    """Share of the gap that is gone in a set."""
    return 1.0 - gaps[name]["all"] / gaps["with"]["all"]


def true_shares(gaps: Gaps, effects: Sequence[str]) -> dict[str, float]:
    """What one, two or three effects share of the true shrink by Shapley's rule; empty for more.

    The worth of a set of effects is the share of the gap that goes with them.
    """
    if "all" not in gaps or not 1 <= len(effects) <= 3:
        return {}
    whole = _closed(gaps, "all")
    if len(effects) == 1:
        return {effects[0]: whole}
    first = {name: _closed(gaps, lacking(name)) for name in effects}
    last = {name: whole - _closed(gaps, alone(name)) for name in effects}
    if len(effects) == 2:
        return {name: 0.5 * (first[name] + last[name]) for name in effects}
    shares = {}
    for name in effects:
        others = [other for other in effects if other != name]
        # The worth of this one with another is what goes when only the third stays.
        second = sum(_closed(gaps, alone(others[1 - i])) - first[other] for i, other in enumerate(others))
        shares[name] = first[name] / 3.0 + second / 6.0 + last[name] / 3.0
    return shares


def _rises(gaps: Gaps | None, effect: TrueEffect) -> dict[str, float]:
    """By how much the effect alone raises the gap of each of its faulty joints, as a share; empty if that is not known."""
    name = alone(effect.effect) if gaps and alone(effect.effect) in gaps else "with"
    if not gaps or "all" not in gaps:
        return {}
    judged = [joint for joint in effect.faulty or effect.joints if joint in gaps[name] and joint in gaps["all"]]
    return {joint: gaps[name][joint] / gaps["all"][joint] - 1.0 for joint in judged}


def must_be_named(gaps: Gaps | None, effect: TrueEffect) -> bool:
    """Whether the effect makes a gap that is worth a name."""
    rises = _rises(gaps, effect)
    return effect.effect in GAPLESS or not rises or max(rises.values()) >= LEAST_RISE


def shown(gaps: Gaps | None, effect: TrueEffect) -> frozenset[str]:
    """The joints in which an effect makes a gap: a limit that a joint never reaches is not there to be found.

    Those whose gap it raises by at least `SHOWN` of what it does to the worst one; all its faulty joints where it raises none.
    """
    rises = _rises(gaps, effect)
    most = max(rises.values(), default=0.0)
    if most < LEAST_RISE:
        return frozenset(effect.faulty or effect.joints)
    return frozenset(joint for joint, rise in rises.items() if rise >= SHOWN * most)
