"""diagnosis.json from what was found in the joints of a layer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.gap.answer.gap_entry import gap_entry, undeclared
from hqpipe.gap.answer.head import head, significant
from hqpipe.gap.answer.layer_causes import SENSING, UNSIGNED, LayerCause, layer_of
from hqpipe.gap.answer.layer_experiment import next_experiment
from hqpipe.gap.answer.layer_verdict import LayerEvidence
from hqpipe.gap.answer.layer_visible import visible_from
from hqpipe.gap.answer.schema import validate_diagnosis
from hqpipe.gap.answer.scope import scope_of
from hqpipe.gap.answer.second_channel import ScaleError
from hqpipe.gap.answer.shapley import Shrink
from hqpipe.gap.change.since import EarlierLogs, EarlierModel
from hqpipe.gap.checks.left_out import LeftOut
from hqpipe.gap.residuals.beyond_fit import BeyondFit
from hqpipe.gap.residuals.joint_scale import pooled
from hqpipe.gap.residuals.layer_errors import RAN_AWAY, LayerErrors
from hqpipe.gap.residuals.locate import Place, telling
from hqpipe.identify.beliefs import BELIEVED
from hqpipe.identify.model import LayerJoints
from hqpipe.layers.actuator.changes import MULTIPLIES
from hqpipe.logs.trajectory import LogSet

MIN_SHARE = 0.01  # signals that explain less of the gap are not listed
UNLIKE = 3.0  # held-out over fitted RMSE beyond which the trials are unlike each other; assumption
UNSIGNED_SURE = 0.99  # assumption: a torque of one sign in both directions of motion may still be that of a large load


def layer_content(
    log_set: LogSet,
    joints: LayerJoints,
    errors: LayerErrors,
    evidence: LayerEvidence,
    causes: Sequence[LayerCause],
    shrink: Shrink,
    unsigned: Sequence[str],
    places: tuple[list[Place], list[Place]],
    warnings: Sequence[str],
    earlier: EarlierLogs | EarlierModel | None,
    left_out: Sequence[LeftOut],
    withdrawn: Mapping[str, str],
    scales: Sequence[ScaleError] = (),
    beyond: Sequence[BeyondFit] = (),
) -> dict[str, Any]:
    """The content of diagnosis.json.

    Args:
        log_set: with the joints that were judged. causes, shrink: in one order. unsigned: joints whose torque lost its sign.
        places: before and after the causes were added. withdrawn: effect → why it is no cause although it was found.
        scales: sensors with a gain of their own, which no model shows. beyond: trials that leave what the fit trials show.
    """
    verdict = evidence.verdict(bool(causes) or bool(unsigned) or bool(scales))
    rest = bool(evidence.rest.any())
    found = [_cause(cause, shrink, i, earlier is not None) for i, cause in enumerate(causes)]
    found = sorted(found, key=lambda c: ("shown_by" not in c, -c["shrink"], -c["probability"]))
    found = [*_unsigned(unsigned, errors.names), *(error.content(errors.names) for error in scales), *found]
    depends = _depends_on(errors, evidence) if rest else []
    beyond = beyond if rest else ()
    content = head(log_set, verdict, earlier, left_out) | {
        "gap": _gap(log_set, joints, errors, evidence, shrink),
        "where": [_place(p, joints.layer, errors) for p in (telling(places[0]) if evidence.gap.any() else [])],
        "causes": found,
        "effects_considered": considered(errors, joints.layer, withdrawn),
        "unexplained": {
            "share_of_gap": significant(evidence.left) if evidence.gap.any() else 0.0,
            "above_noise": rest,
            "where": [_place(p, joints.layer, errors) for p in (telling(places[1]) if rest else [])],
            "depends_on": depends,
        },
        "next_experiment": next_experiment(
            joints.layer,
            found,
            rest,
            depends,
            _worst(errors, evidence),
            [trial.file for trial in beyond],
            log_set.kinds,
        ),
        "warnings": [
            *(trial.text for trial in beyond),
            *warnings,
            *undeclared(log_set, errors.scale),
            *_remarks(errors, evidence),
        ],
    }
    validate_diagnosis(content)
    return content


def _gap(
    log_set: LogSet, joints: LayerJoints, errors: LayerErrors, evidence: LayerEvidence, shrink: Shrink
) -> dict[str, Any]:
    squares = {
        "before": evidence.before,
        "after": evidence.after,
        "noise_floor": evidence.noise,
        "persistence": evidence.persistence,
    }
    return {
        "layer": joints.layer,
        "metric": joints.metric,
        "window_s": significant(joints.window_s),
        "window_reason": joints.window_reason,
        **gap_entry(log_set, squares, errors.scale, errors.units),
        "shrink": significant(shrink.whole),
        "shrink_ci95": [significant(end) for end in shrink.whole_ci95],
    }


def _cause(cause: LayerCause, shrink: Shrink, i: int, compared: bool) -> dict[str, Any]:
    low, high = sorted(shrink.each_ci95[i])
    parameters = {}
    for number in cause.numbers:
        entry: dict[str, Any] = {
            "value": significant(number.value),
            "unit": number.unit,
            "ci95": _interval(number.ci95),
        }
        if compared and cause.effect not in MULTIPLIES:  # a ratio says itself what it refers to
            entry["reference"] = None if number.reference is None else significant(number.reference)
        if len(cause.members) > 1:
            key = number.name, number.unit
            own = {j: n for j, member in cause.members.items() for n in member.numbers if (n.name, n.unit) == key}
            entry["joints"] = {j: {"value": significant(n.value), "ci95": _interval(n.ci95)} for j, n in own.items()}
        parameters[number.name] = entry
    return {
        "effect": cause.effect,
        "layer": cause.layer,
        "joints": list(cause.joints),
        "scope": cause.scope,
        "probability": significant(cause.probability),
        "parameters": parameters,
        "shrink": significant(shrink.each[i]),
        "shrink_ci95": [significant(low), significant(high)],
        "confused_with": list(cause.rivals),
        **({"shown_by": cause.shown_by} if cause.shown_by else {}),
    }


def _interval(ends: tuple[float, float]) -> list[float]:
    return [significant(end) for end in ends]


def _unsigned(joints: Sequence[str], machine: Sequence[str]) -> list[dict[str, Any]]:
    """The lost sign, which the layer does without: it closes nothing of the gap that is stated."""
    if not joints:
        return []
    return [
        {
            "effect": UNSIGNED,
            "layer": SENSING,
            "joints": list(joints),
            "scope": scope_of(joints, machine),
            "probability": UNSIGNED_SURE,
            "parameters": {},
            "shrink": 0.0,
            "shrink_ci95": [0.0, 0.0],
            "confused_with": [],
        }
    ]


def considered(errors: LayerErrors, layer: str, withdrawn: Mapping[str, str]) -> list[dict[str, Any]]:
    """Effects that no joint was given, the best first. The score is what a normal deviate would be at the same odds."""
    accepted = {cause.effect: cause for joint in errors.joints for cause in joint.found.causes}
    rivals = {name: cause.effect for cause in accepted.values() for name in cause.confused_with}
    known = dict.fromkeys(e.name for joint in errors.joints for e in joint.found.model.effects if e.named)
    rows = []
    for effect in (name for name in known if name not in accepted):
        gains = {joint.name: joint.found.gains[effect] for joint in errors.joints if effect in joint.found.gains}
        joints = [joint for joint, gain in gains.items() if gain > 0.0]
        best = max(gains.values(), default=0.0)
        if effect in withdrawn:
            reason = withdrawn[effect]
        elif effect in rivals:
            reason = f"could take the place of {rivals[effect]}: the logs do not rule it out"
        elif any(effect in joint.found.withdrawn for joint in errors.joints):
            reason = "the fit trials ask for it, but it does not show in the held-out ones"
        elif any(effect in joint.found.minor for joint in errors.joints):
            reason = "it closes less than half of what is left unexplained, of which it may be a part"
        elif max(joint.found.probabilities.get(effect, 0.0) for joint in errors.joints) > BELIEVED:
            reason = (
                "it is there, but closes too little of the gap, is too small or too uncertain, or stands at its bound"
            )
        elif best > 0.0:
            reason = "helps, but the logs are as probable without it"
        else:
            reason = "the logs are no more probable with it" if gains else "nothing of the error points to it"
            reason += visible_from([joint.found for joint in errors.joints], effect)
        rows.append(
            {
                "effect": effect,
                "layer": layer_of(effect, layer),
                "joints": joints,
                "scope": scope_of(joints, errors.names),
                "score": significant(float(np.sqrt(2.0 * max(best, 0.0)))),
                "shrink": None,
                "reason": reason,
            }
        )
    return sorted(rows, key=lambda row: -row["score"])


def _depends_on(errors: LayerErrors, evidence: LayerEvidence) -> list[dict[str, Any]]:
    """Signals by the share of the remaining gap that a generic shape of them closes, over the joints where it is open."""
    clear = evidence.rest & evidence.predictable
    total = float(((evidence.after - evidence.floor) / evidence.scale**2)[evidence.rest].sum())
    found: dict[str, dict[str, float]] = {}
    for j in np.flatnonzero(clear):
        for signal, share in errors.joints[j].found.shapes.items():
            if share > MIN_SHARE:
                closed = share * float(evidence.after[j] / evidence.scale[j] ** 2)
                found.setdefault(signal, {})[errors.names[j]] = closed
    rows = [
        {"signal": name, "joints": list(parts), "share": significant(min(1.0, sum(parts.values()) / total))}
        for name, parts in found.items()
    ]
    return sorted(rows, key=lambda row: -row["share"])


def _worst(errors: LayerErrors, evidence: LayerEvidence) -> str:
    return errors.names[int(np.argmax((evidence.after - evidence.floor) / evidence.scale**2))]


def _remarks(errors: LayerErrors, evidence: LayerEvidence) -> list[str]:
    """What the numbers alone do not say."""
    remarks, scale = [], errors.scale
    if fitted_only := [joint.name for joint in errors.joints if not joint.heldout]:
        remarks.append(
            f"{', '.join(fitted_only)}: no held-out trial, so that the errors are those of the fitted trials, which flatter "
            "the model; hold a trial out"
        )
    for joint in errors.joints:
        if (share := joint.ran_away) > 0.0:
            remarks.append(
                f"{joint.name}: the prediction runs away in {share:.1%} of the samples, which count {RAN_AWAY:g} spreads"
            )
    before, persistence = pooled(evidence.before, scale), pooled(evidence.persistence, scale)
    if before > persistence:
        remarks.append(
            f"the base model is off by {before:.2%} of the joints' spread, holding the output of the window start by "
            f"{persistence:.2%}: it is worse"
        )
    if evidence.gap.any():
        closable = pooled(evidence.flexible, scale) ** 2 / max(before**2, 1e-300)
        remarks.append(
            f"a flexible model predicts {max(1.0 - closable, 0.0):.0%} of the base model's squared error from logged signals"
        )
    judged = [joint for joint in errors.joints if joint.heldout]
    fitted, held = (
        np.sqrt(np.mean([np.mean(e**2) / joint.scale**2 for joint, e in pairs])) if (pairs := list(parts)) else 0.0
        for parts in (
            ((joint, joint.bounded(joint.found.base.error)) for joint in judged),
            ((joint, joint.bounded(joint.found.base.heldout)) for joint in judged),
        )
    )
    if held > UNLIKE * fitted:
        remarks.append(
            f"the base model is off by {fitted:.2%} of the joints' spread in the fit trials and by {held:.2%} in the "
            "held-out ones: something acts in these that no fit trial shows; give the fit a trial of their kind"
        )
    if outer := [
        name for name, open_ in zip(errors.names, evidence.rest & ~evidence.predictable, strict=True) if open_
    ]:
        remarks.append(
            f"{', '.join(outer)}: no logged signal predicts the error above the noise floor: coloured noise, an outer "
            "cause, or held-out trials unlike the fit trials"
        )
    return remarks


def _place(p: Place, layer: str, errors: LayerErrors) -> dict[str, Any]:
    return {
        "layer": layer,
        "joint": p.joint,
        "regime": p.regime,
        "share": significant(p.share),
        "rmse": significant(p.rmse),
        "unit": errors.units[errors.names.index(p.joint)],
        "normalised": significant(p.normalised),
    }
