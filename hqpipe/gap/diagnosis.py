"""Where the model misses the machine: the diagnosis of a log set, and its files."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.gap.locate import Place, locate, telling
from hqpipe.gap.noise import free_run_floor
from hqpipe.gap.reference import Explained, explain
from hqpipe.gap.replay import Replay, memory, persistence_error, replay
from hqpipe.gap.schema import FORMAT, validate_diagnosis
from hqpipe.gap.sensing import channel_warnings, model_warnings
from hqpipe.gap.tally import tally
from hqpipe.gap.verdict import Evidence, shortage, weigh
from hqpipe.logs.columns import joint_column
from hqpipe.logs.trajectory import LogSet
from hqpipe.sysid.free_run import WINDOW_S, Model
from hqpipe.sysid.noise import noise_floor

LAYER = "actuator"
FILE, TABLE = "diagnosis.json", "residuals.csv"
NO_CANDIDATE = "no candidate effect was tried: the diagnosis says where the error is, not what causes it"
_NEEDED = ("effort", "position_command")
_MIN_SHARE = 0.01  # signals that explain less of the gap are not listed


@dataclass(frozen=True)
class Diagnosis:
    """The content of diagnosis.json, and the table behind it.

    Attributes:
        content: JSON-able, valid against `hqpipe.gap.schema`.
        table: (trial, place) rows; the trial "all" pools the held-out trials.
    """

    content: dict[str, Any]
    table: tuple[tuple[str, Place], ...] = ()

    @property
    def verdict(self) -> str:
        return self.content["verdict"]


def diagnose(log_set: LogSet, model: Model | None, *, window_s: float = WINDOW_S) -> Diagnosis:
    """Say whether the error on the held-out trials exceeds the noise, where it is and what it depends on.

    Args:
        log_set: fit and held-out trials of one machine.
        model: the actuator model fitted to the fit trials; None if the logs cannot carry one.
        window_s: length of the free-running windows, s.

    Raises:
        IdentificationError: no layer can be evaluated.
    """
    trials = [trial.trajectory for trial in log_set.trials]
    lacking = [name for name in _NEEDED if getattr(trials[0], name) is None]
    if "effort" in lacking:
        raise IdentificationError(
            f"{log_set.path}: no layer can be evaluated without '{joint_column('<name>', 'effort')}'; "
            "record the joint torque (for the actuator layer with the position command)"
        )
    warnings = [*log_set.warnings, *channel_warnings(trials)]
    if lacking or model is None:
        missing = " and ".join(joint_column("<name>", name) for name in lacking) or "a fitted actuator model"
        reason = f"the actuator layer needs {missing}: only the sensing layer was evaluated"
        return Diagnosis(_not_identifiable(log_set, [*warnings, reason], "record the missing channels"))
    return _actuator(log_set, model, window_s, warnings)


def _actuator(log_set: LogSet, model: Model, window_s: float, warnings: list[str]) -> Diagnosis:
    fit = [replay(trial, model, window_s) for trial in log_set.fit]
    heldout = [replay(trial, model, window_s) for trial in log_set.heldout]
    sensor = np.array([noise_floor(log_set.heldout or log_set.fit, j).value for j in log_set.joints]) ** 2
    reasons, excited = shortage(fit, heldout, sensor)
    if reasons:
        advice = "record longer trials in which every joint moves, one of them held out"
        return Diagnosis(_not_identifiable(log_set, [*warnings, *reasons], advice))
    fit, heldout = [r for r in fit if r.windows], [r for r in heldout if r.windows]
    warnings = [*warnings, *model_warnings(heldout)]
    kept = np.mean([memory(item, model) for item in heldout], axis=0)
    pole = np.mean([memory(item, model) for item in fit], axis=0)[0]
    explained = [explain(fit, heldout, j, pole[j]) for j in range(len(log_set.joints))]
    sums = tally(heldout)
    evidence = weigh(sums, free_run_floor(heldout, sensor, kept), explained)
    places = locate(sums, evidence.floor, log_set.joints)
    table = [("all", place) for place in places]
    for index, item in enumerate(heldout):
        table += [(item.file, p) for p in locate(sums.of_trial(index), evidence.floor, log_set.joints)]
    content = _content(log_set, window_s, heldout, evidence, explained, places)
    still = [joint for joint, moved in zip(log_set.joints, excited, strict=True) if not moved]
    if still:
        warnings.append(f"too little excitation to judge {', '.join(still)}")
    content["warnings"] = [*warnings, *_remarks(log_set.joints, evidence, content["gap"]), NO_CANDIDATE]
    validate_diagnosis(content)
    return Diagnosis(content, tuple(table))


def _content(
    log_set: LogSet,
    window_s: float,
    heldout: list[Replay],
    evidence: Evidence,
    explained: list[Explained],
    places: list[Place],
) -> dict[str, Any]:
    unknown = bool(evidence.gap.any())
    error = _rms(evidence.error)
    where = [
        {"layer": LAYER, "joint": p.joint, "regime": p.regime, "share": _short(p.share)}
        for p in (telling(places) if unknown else [])
    ]
    gap = {
        "layer": LAYER,
        "metric": "free_run_rmse",
        "unit": "N·m",
        "window_s": window_s,
        "before": error,
        "after": error,
        "noise_floor": _rms(evidence.floor),
        "persistence": _rms(persistence_error(heldout)),
        "shrink": 0.0,
        "shrink_ci95": [0.0, 0.0],
    }
    return _head(log_set, "unknown" if unknown else "no_gap") | {
        "gap": gap,
        "where": where,
        "causes": [],
        "effects_considered": [],
        "unexplained": {
            "share_of_gap": 1.0 if unknown else 0.0,
            "above_noise": unknown,
            "where": where,
            "depends_on": _depends_on(log_set.joints, evidence, explained),
        },
        "next_experiment": None,
    }


def _depends_on(joints: tuple[str, ...], evidence: Evidence, explained: list[Explained]) -> list[dict[str, Any]]:
    """Signals by the share of the gap that they explain, pooled over the joints where it is predictable."""
    clear = evidence.gap & evidence.predictable
    total = np.sum((evidence.error - evidence.floor)[evidence.gap])
    found: dict[str, dict[str, float]] = {}
    for j in np.flatnonzero(clear):
        for signal, drop in explained[j].signals.items():
            if drop > _MIN_SHARE * (evidence.error[j] - evidence.floor[j]):
                found.setdefault(signal, {})[joints[j]] = drop
    rows = [
        {"signal": name, "joints": list(drops), "share": _short(min(1.0, sum(drops.values()) / total))}
        for name, drops in found.items()
    ]
    return sorted(rows, key=lambda row: -row["share"])


def _remarks(joints: tuple[str, ...], evidence: Evidence, gap: dict[str, Any]) -> list[str]:
    """What the numbers alone do not say."""
    found = []
    if gap["before"] > gap["persistence"]:
        found.append(
            f"the model ({gap['before']:.4g} N·m) is worse than holding the torque of the window start "
            f"({gap['persistence']:.4g} N·m)"
        )
    if evidence.gap.any():
        share = np.sum(np.maximum(evidence.explained, 0.0) * evidence.error) / np.sum(evidence.error)
        found.append(f"a flexible reference model explains {share:.0%} of the squared held-out error")
    if (outer := evidence.above & ~evidence.predictable).any():
        names = ", ".join(np.array(joints)[outer])
        found.append(
            f"{names}: no logged signal predicts the error above the noise floor: coloured noise, an outer "
            "cause, or held-out trials unlike the fit trials"
        )
    return found


def _not_identifiable(log_set: LogSet, warnings: list[str], advice: str) -> dict[str, Any]:
    content = _head(log_set, "not_identifiable") | {
        "gap": None,
        "where": [],
        "causes": [],
        "effects_considered": [],
        "unexplained": {"share_of_gap": None, "above_noise": False, "where": [], "depends_on": []},
        "next_experiment": advice,
        "warnings": [*warnings, NO_CANDIDATE],
    }
    validate_diagnosis(content)
    return content


def _head(log_set: LogSet, verdict: str) -> dict[str, Any]:
    logs = {
        "path": str(log_set.path),
        "sha256": log_set.sha256,
        "trials": len(log_set.trials),
        "joints": list(log_set.joints),
        "control_mode": log_set.control_mode,
    }
    return {"format": FORMAT, "verdict": verdict, "logs": logs}


def _rms(mean_square: np.ndarray) -> float:
    return _short(float(np.sqrt(np.mean(mean_square))))


def _short(value: float) -> float:
    return float(f"{value:.6g}")


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.json and residuals.csv; the same diagnosis gives the same bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    validate_diagnosis(diagnosis.content)
    text = json.dumps(diagnosis.content, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / FILE).write_text(text + "\n", encoding="utf-8")
    columns = ("joint", "family", "regime", "samples", "rmse", "share", "share_low", "share_high")
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["trial", "joint", "family", "regime", "n", *columns[4:]])
        for trial, place in diagnosis.table:
            row = asdict(place)
            writer.writerow([trial, *(_cell(row[name]) for name in columns)])


def _cell(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def read_diagnosis(path: Path) -> dict[str, Any]:
    """Read and check a diagnosis.json.

    Raises:
        ConfigError: a key is missing, unknown or of the wrong type.
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    validate_diagnosis(content)
    return content
