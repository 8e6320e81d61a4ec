"""diagnosis.json from what was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hqpipe.gap.accuse import WINDOWS_PER_BLOCK, Accusation
from hqpipe.gap.bootstrap import block_weights, interval
from hqpipe.gap.causes import Cause
from hqpipe.gap.changes import CANDIDATES, FACTORS
from hqpipe.gap.considered import considered, significant
from hqpipe.gap.gap_entry import gap_entry, output_unit, undeclared
from hqpipe.gap.groups import scope_of
from hqpipe.gap.joint_scale import pooled
from hqpipe.gap.left_out import LeftOut
from hqpipe.gap.locate import Place, telling
from hqpipe.gap.reference import Explained
from hqpipe.gap.replay import persistence_error
from hqpipe.gap.schema import FORMAT, validate_diagnosis
from hqpipe.gap.search import MATERIAL
from hqpipe.gap.signs import NAME as UNSIGNED
from hqpipe.gap.signs import SignedLogs
from hqpipe.gap.since import Earlier, EarlierLogs
from hqpipe.gap.verdict import FLOOR_MARGIN, Evidence
from hqpipe.logs.joint_kinds import unit_of
from hqpipe.logs.trajectory import LogSet, recording_of
from hqpipe.sysid.window_choice import WindowChoice

LAYER = "actuator"
EXPLAINED = 0.25  # of the squared error above the noise may be left in an explained gap; assumption
NEAR_FLOOR = 2.0
"""Error left over the noise floor, both RMS, from which a gap is not called explained, whatever share of it was closed:
something of the size of what the noise does, or more, is still missing. Assumption."""
UNLIKE = 3.0  # held-out over fitted RMSE beyond which the trials are unlike each other; assumption
UNSIGNED_EVEN, UNSIGNED_STEEPNESS = 0.7, 10.0  # error ratio of the sign search at even odds, and how fast they grow
MISSES = 1.5  # RMSE over the noise floor from which it is told that a reference itself misses its machine; assumption
MIN_SHARE = 0.01  # signals that explain less of the gap are not listed
SIGNALS = {
    "torque": {"position_error": "torque_error", "past_position_error": "past_torque_error"},
}
"""What the shapes of `hqpipe.gap.signals` stand for outside position mode, see `hqpipe.gap.row_model`."""
COMMAND_UNITS = {"position": "rad", "torque": "N·m"}

Pair = tuple[Any, Any]


def answer(
    log_set: LogSet,
    signed: SignedLogs,
    window: WindowChoice,
    found: Accusation,
    scales: list[Cause],
    evidence: tuple[Evidence, Evidence],
    explained: tuple[list[Explained], list[Explained]],
    places: tuple[list[Place], list[Place]],
    warnings: list[str],
    earlier: Earlier | None = None,
    left_out: Sequence[LeftOut] = (),
) -> dict[str, Any]:
    """The content of diagnosis.json.

    Args:
        log_set: as it was diagnosed. signed: joints whose sign was restored. found: the search.
        scales: torque sensors with a wrong gain; no part of the gap, for the coefficients take it up.
        evidence, explained, places: before and after the causes were added.
        warnings: so far.
        earlier: the record that the logs are compared with. left_out: parts of the logs that were not used.
    """
    gap_before, gap_after = (_matters(e, found) for e in evidence)
    unexplained = bool(gap_after.any())
    weight = found.scale**-2.0
    excess_before, excess_after = (
        (weight * np.maximum(e.error - found.floor, 0.0))[gap_before].sum() for e in evidence
    )
    if found.raw is not None:
        excess_before = max(float(weight @ (found.raw.mean(axis=0) - found.floor)), excess_before)
    left = float(excess_after / excess_before) if excess_before > 0 else 0.0
    raw, room = _before_signs(found, evidence[0]), _room(found, evidence)
    bare, full = (pooled(e.error, found.scale) for e in evidence)
    part = bare / raw if raw > 0.0 else 0.0  # the causes' shares are of the error once the signs are back
    whole = 1.0 - full / max(bare, 1e-300)
    if found.shrink.whole > 0.0:
        part *= whole / found.shrink.whole  # the search thins the windows of long logs, the gap is of all of them
    lost = signed.findings and not (earlier and set(signed.joints) <= set(earlier.unsigned))
    causes = [_unsigned(signed, log_set, found, evidence[0])] if lost else []
    causes += [cause_entry(cause, log_set) for cause in scales]
    causes += [
        cause_entry(cause, log_set, part * found.shrink.each[i], part * (found.shrink.each_ci95[i] + [0.0, room]))
        for i, cause in enumerate(found.causes)
    ]
    far = full > NEAR_FLOOR * pooled(found.floor, found.scale)
    verdict = _verdict(bool(causes), bool(gap_before.any()), unexplained, left, far)
    passing = {joint for cause in found.passing for joint in cause.joints}
    where = [_place(p, log_set) for p in (telling(places[0], passing) if gap_before.any() else [])]
    remaining = [_place(p, log_set) for p in (telling(places[1]) if unexplained else [])]
    content = head(log_set, verdict, earlier, left_out) | {
        "gap": _gap(log_set, window, found, evidence),
        "where": where,
        "causes": causes,
        "effects_considered": considered(found, log_set),
        "unexplained": {
            "share_of_gap": significant(min(left, 1.0)),
            "above_noise": unexplained,
            "where": remaining,
            "depends_on": _depends_on(log_set, evidence[1], explained[1], gap_after, found.scale),
        },
        "next_experiment": _next(causes, unexplained, found),
        "warnings": [
            *warnings,
            *undeclared(log_set, found.scale),
            *_known_miss(found, earlier),
            *_remarks(log_set.joints, evidence, found),
        ],
    }
    validate_diagnosis(content)
    return content


def _matters(evidence: Evidence, found: Accusation) -> np.ndarray:
    """(J,) True where the error exceeds the noise, and by an amount that a simulator would notice."""
    size = np.array([state.data.output for state in found.states])
    return evidence.gap & (evidence.error - evidence.floor > (MATERIAL * size) ** 2)


def _verdict(causes: bool, gap: bool, unexplained: bool, left: float, far: bool) -> str:
    if not causes:
        return "unknown" if gap else "no_gap"
    return "explained" if not unexplained or (left <= EXPLAINED and not far) else "partly_explained"


def _before_signs(found: Accusation, evidence: Evidence) -> float:
    """Pooled error of the base model on the log as it came."""
    return pooled(evidence.error if found.raw is None else found.raw.mean(axis=0), found.scale)


def _room(found: Accusation, evidence: tuple[Evidence, Evidence]) -> float:
    """Share of the error before that is left above the sensors' noise, as far as that is known: a cause could be worth so much
    more than its model shows, for what it stirs up beyond prediction, as chatter, would go with it."""
    before, after = (pooled(e.error, found.scale) for e in evidence)
    noise = pooled(found.sensor / FLOOR_MARGIN, found.scale)
    return max(after - noise, 0.0) / max(before, 1e-300) if found.causes else 0.0


def _gap(
    log_set: LogSet, window: WindowChoice, found: Accusation, evidence: tuple[Evidence, Evidence]
) -> dict[str, Any]:
    signed, after = (pooled(e.error, found.scale) for e in evidence)
    before = _before_signs(found, evidence[0])
    part = signed / before if before > 0 else 0.0
    low, high = found.shrink.whole_ci95 if found.raw is None else _fall(found.raw, found.final, found.scale)
    squares = {
        "before": evidence[0].error if found.raw is None else found.raw.mean(axis=0),
        "after": evidence[1].error,
        "noise_floor": found.noise,
        "persistence": persistence_error(found.heldout),
    }
    return {
        "layer": LAYER,
        "metric": "free_run_rmse",
        "window_s": window.seconds,
        "window_reason": window.reason,
        **gap_entry(log_set, squares, found.scale),
        "shrink": significant(1.0 - after / before) if before > 0 else 0.0,
        "shrink_ci95": [significant(low), significant(min(high + part * _room(found, evidence), 1.0))],
    }


def cause_entry(
    cause: Cause, log_set: LogSet, shrink: float = 0.0, interval: Sequence[float] | np.ndarray = (0.0, 0.0)
) -> dict[str, Any]:
    """A cause as in diagnosis.json, and how far it shrinks the gap that is stated."""
    effect = CANDIDATES[cause.effect]
    units = {p.name: p.unit.replace("command", COMMAND_UNITS[log_set.control_mode]) for p in effect.parameters}
    kind = None if effect.machine else log_set.kinds.get(cause.joints[0])
    parameters = {
        name: {
            "value": significant(part.value),
            "unit": unit_of(units[name], kind),
            "ci95": [significant(part.low), significant(part.high)],
        }
        for name, part in cause.parameters.items()
    }
    for name, then in cause.then.items():
        parameters[name]["reference"] = then if then is None else significant(then)
    return {
        "effect": cause.effect,
        "layer": effect.layer,
        "joints": list(cause.joints),
        "scope": cause.scope,
        "probability": significant(cause.probability),
        "parameters": parameters,
        "shrink": significant(shrink),
        "shrink_ci95": sorted([significant(interval[0]), significant(interval[1])]),
        "confused_with": list(cause.rivals),
    }


def _unsigned(signed: SignedLogs, log_set: LogSet, found: Accusation, evidence: Evidence) -> dict[str, Any]:
    """The cause that was removed before anything else, with what that did to the base model's error."""
    low, high = _fall(
        found.raw, np.stack([state.of_machine(state.base) for state in found.states], axis=1), found.scale
    )
    shrink = 1.0 - pooled(evidence.error, found.scale) / _before_signs(found, evidence)
    ratio = float(np.mean([entry.error_ratio for entry in signed.findings]))
    return {
        "effect": UNSIGNED,
        "layer": "sensing",
        "joints": list(signed.joints),
        "scope": scope_of(signed.joints, log_set.joints),
        "probability": significant(1.0 / (1.0 + np.exp(UNSIGNED_STEEPNESS * (ratio - UNSIGNED_EVEN)))),
        "parameters": {},
        "shrink": significant(shrink),
        "shrink_ci95": [significant(min(low, shrink)), significant(max(high, shrink))],
        "confused_with": [],
    }


def _fall(before: np.ndarray, after: np.ndarray, scale: np.ndarray) -> tuple[float, float]:
    """95 % interval of the fall of the pooled error, from (W, J) squared errors per window; scale: (J,)."""
    before, after = ((square / scale**2).sum(axis=1) for square in (before, after))
    edges = np.arange(0, len(before), WINDOWS_PER_BLOCK)
    weights = block_weights(len(edges))
    low, high = interval(
        1.0 - np.sqrt((weights @ np.add.reduceat(after, edges)) / (weights @ np.add.reduceat(before, edges)))
    )
    return float(low), float(high)


def _depends_on(
    log_set: LogSet, evidence: Evidence, explained: list[Explained], gap: np.ndarray, scale: np.ndarray
) -> list[dict[str, Any]]:
    """Signals by the share of the remaining gap that they explain, over the joints where it is predictable."""
    joints, known = log_set.joints, SIGNALS.get(log_set.control_mode, {})
    clear = gap & evidence.predictable
    total = np.sum(((evidence.error - evidence.floor) / scale**2)[gap])
    found: dict[str, dict[str, float]] = {}
    for j in np.flatnonzero(clear):
        for signal, drop in explained[j].signals.items():
            if drop > MIN_SHARE * (evidence.error[j] - evidence.floor[j]):
                found.setdefault(known.get(signal, signal), {})[joints[j]] = drop / scale[j] ** 2
    rows = [
        {"signal": name, "joints": list(drops), "share": significant(min(1.0, sum(drops.values()) / total))}
        for name, drops in found.items()
    ]
    return sorted(rows, key=lambda row: -row["share"])


def _next(causes: list[dict[str, Any]], unexplained: bool, found: Accusation) -> str | None:
    """The experiment that would settle what is open, the most important first."""
    for cause in causes:
        if cause["confused_with"]:
            rival = cause["confused_with"][0]
            return (
                f"to tell {cause['effect']} from {rival} in {', '.join(cause['joints'])}: "
                f"{CANDIDATES[cause['effect']].experiment}"
            )
    if unexplained:
        worst = max(found.states, key=lambda s: s.chosen.error / max(s.data.output, 1e-300) ** 2)
        return (
            f"no effect of the library fits what is left; excite {worst.joint} alone, slowly and then fast, "
            "with the others held, and log all that its controller measures and sends"
        )
    return None


def _known_miss(found: Accusation, earlier: Earlier | None) -> list[str]:
    """What the record itself leaves open, and which coefficients it lacks."""
    if earlier is None:
        return []
    notes, known = [], pooled(found.familiar, found.scale)
    if known > MISSES * pooled(found.noise, found.scale):
        notes.append(
            f"the reference is no better than {known:.2%} of the joints' spread on a machine that has not changed: less is no "
            "change"
        )
    for name in (name for name in FACTORS if name in found.library):
        if lacking := [s.joint for s in found.states if name not in s.search.library]:
            notes.append(
                f"{', '.join(lacking)}: {FACTORS[name][0]} is 0 in the reference, so that {name} has no ratio and was not asked"
            )
    return notes


def _remarks(joints: tuple[str, ...], evidence: tuple[Evidence, Evidence], found: Accusation) -> list[str]:
    """What the numbers alone do not say."""
    remarks = []
    for cause in found.passing:
        times = ", ".join(
            f"{start:.1f}–{end:.1f} s of {recording_of(found.heldout[i])}" for i, start, end in found.spans.stretches
        )
        remarks.append(f"{cause.effect} acts for some time only: {times}")
    before, persistence = (pooled(s, found.scale) for s in (evidence[0].error, persistence_error(found.heldout)))
    if before > persistence:
        remarks.append(
            f"the base model is off by {before:.2%} of the joints' spread, holding the output of the window start by "
            f"{persistence:.2%}: it is worse"
        )
    if evidence[0].gap.any():
        relative = evidence[0].error / found.scale**2
        share = np.sum(np.maximum(evidence[0].explained, 0.0) * relative) / np.sum(relative)
        remarks.append(
            f"a flexible model predicts {share:.0%} of the base model's squared held-out error from the logged signals"
        )
    fitted = pooled(np.array([state.base.fitted.mean() for state in found.states]), found.scale)
    if before > UNLIKE * fitted:
        remarks.append(
            f"the base model is off by {fitted:.2%} of the joints' spread in the fit trials and by {before:.2%} in the "
            "held-out ones: something acts in these that no fit trial shows; give the fit a trial of their kind"
        )
    outer = evidence[1].above & ~evidence[1].predictable & _matters(evidence[1], found)
    if outer.any():
        names = ", ".join(np.array(joints)[outer])
        remarks.append(
            f"{names}: no logged signal predicts the error above the noise floor: coloured noise, an outer "
            "cause, or held-out trials unlike the fit trials"
        )
    return remarks


def not_identifiable(
    log_set: LogSet,
    warnings: list[str],
    advice: str | None,
    earlier: Earlier | EarlierLogs | None = None,
    left_out: Sequence[LeftOut] = (),
) -> dict[str, Any]:
    """The answer when the logs cannot carry one."""
    content = head(log_set, "not_identifiable", earlier, left_out) | {
        "gap": None,
        "where": [],
        "causes": [],
        "effects_considered": [],
        "unexplained": {"share_of_gap": None, "above_noise": False, "where": [], "depends_on": []},
        "next_experiment": advice,
        "warnings": warnings,
    }
    validate_diagnosis(content)
    return content


def head(
    log_set: LogSet, verdict: str, earlier: Earlier | EarlierLogs | None, left_out: Sequence[LeftOut]
) -> dict[str, Any]:
    """Format, verdict, logs, what was left out of them, and what they are compared with."""
    logs = {
        "path": str(log_set.path),
        "sha256": log_set.sha256,
        "trials": len({(recording_of(trial), trial.split) for trial in log_set.trials}),
        "joints": list(log_set.joints),
        "control_mode": log_set.control_mode,
    }
    reference = {} if earlier is None else {"reference": earlier.header()}
    without = {"left_out": [item.content() for item in left_out]}
    return {"format": FORMAT, "verdict": verdict, "logs": logs} | without | reference


def _place(p: Place, log_set: LogSet) -> dict[str, Any]:
    sizes = {
        "rmse": significant(p.rmse),
        "unit": output_unit(log_set, p.joint),
        "normalised": significant(p.normalised),
    }
    return {"layer": LAYER, "joint": p.joint, "regime": p.regime, "share": significant(p.share), **sizes}
