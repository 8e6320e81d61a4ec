"""The diagnosis of a log set: where the gap is, what causes it, how far it shrinks; and its files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import save_actuator
from hqpipe.errors import ConfigError
from hqpipe.files.documents import read_table
from hqpipe.gap.accuse import Accusation, accuse
from hqpipe.gap.answer import answer, not_identifiable
from hqpipe.gap.changes import SCALE, multiplied
from hqpipe.gap.gap_entry import output_unit
from hqpipe.gap.intake import LONGER, Intake, take_in
from hqpipe.gap.joint_data import by_speed
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.left_joints import plain_joints, whole_machine
from hqpipe.gap.level_answer import ADVICE, by_levels
from hqpipe.gap.levels import BLIND, levels_of
from hqpipe.gap.locate import Place, locate
from hqpipe.gap.reference import Explained
from hqpipe.gap.replay import persistence_error
from hqpipe.gap.rest import Rest
from hqpipe.gap.row_model import RowModel
from hqpipe.gap.schema import FIX, validate_diagnosis
from hqpipe.gap.second_channel import measured, scale_causes, settle_offsets
from hqpipe.gap.since import MODE, Earlier
from hqpipe.gap.since_intake import only_known
from hqpipe.gap.tally import ALL, Tally, tally
from hqpipe.gap.traces import worst_windows
from hqpipe.gap.verdict import Evidence, shortage, weigh
from hqpipe.logs.trajectory import LogSet

LARGEST = 3_800_000  # samples × joints in memory: 5 min of twelve joints at 1 kHz, which takes 1.5 GB
FILE, TABLE, TRACES = "diagnosis.json", "residuals.csv", "traces.json"
HELD = "rmse_persistence"
Progress = Callable[[float, float, str], None]


@dataclass(frozen=True)
class Row:
    """One joint in one regime, before and after; the trial "all" pools the held-out trials.

    Attributes:
        unit: of the RMSE. held: RMSE of holding the output, of a whole joint in all trials; None elsewhere.
    """

    trial: str
    before: Place
    after: Place | None
    unit: str
    held: float | None = None


@dataclass(frozen=True)
class Diagnosis:
    """The content of diagnosis.json, and what lies behind it.

    Attributes:
        content: JSON-able, valid against `hqpipe.gap.schema`.
        table: joint × regime.
        traces: measured and predicted torque round the worst window of each joint.
        base, augmented: the actuator model of all joints without and with the effects found, those that were left out
            without any; None outside position mode, or where a joint has no sound logs.
    """

    content: dict[str, Any]
    table: tuple[Row, ...] = ()
    traces: dict[str, Any] = field(default_factory=dict)
    base: ActuatorModel | None = None
    augmented: ActuatorModel | None = None

    @property
    def verdict(self) -> str:
        return self.content["verdict"]


def diagnose(
    log_set: LogSet,
    *,
    window_s: float | None = None,
    without: Sequence[str] = (),
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    earlier: Earlier | None = None,
) -> Diagnosis:
    """Say whether the error on the held-out trials exceeds the noise, where it is and what causes it.

    Args:
        log_set: fit and held-out trials of one machine.
        window_s: length of the free-running windows, s; None for that of `earlier` logs, or for what suits the logs.
        without: effects left out of the library.
        effort_limit: (J,) N·m at which the actuator saturates; None for no limit.
        workers: joints searched at a time; the answer does not depend on it.
        progress: called with (done, total, text).
        earlier: a record of the same machine; then only what changed since is a cause.

    Raises:
        IdentificationError: no layer can be evaluated.
        UsageError: the record does not fit to the logs.
    """
    if earlier is not None:
        earlier.fits(log_set)
    if window_s is None and earlier is not None and earlier.window_s is not None:
        intake = take_in(log_set, earlier.window_s, without)
        intake = replace(intake, window=replace(intake.window, reason="as long as those of the reference"))
    else:
        intake = take_in(log_set, window_s, without)
    if earlier is not None:
        intake = only_known(intake, earlier)
        intake = replace(intake, warnings=(*intake.warnings, *earlier.warnings))
    if intake.reasons:
        warnings = list(intake.warnings)
        return Diagnosis(not_identifiable(intake.log_set, warnings, intake.advice, earlier, intake.left_out))
    return _actuator(intake, log_set.joints, without, effort_limit, workers, progress, earlier)


def _actuator(
    intake: Intake,
    machine: tuple[str, ...],
    without: Sequence[str],
    effort_limit: np.ndarray | None,
    workers: int,
    progress: Progress | None,
    earlier: Earlier | None,
) -> Diagnosis:
    """The answer for the joints that are left.

    Args:
        machine: joints of the logs as they came; `effort_limit` is of these.
    """
    log_set, signed, warnings = intake.log_set, intake.signed, list(intake.warnings)
    limit = None if effort_limit is None else effort_limit[[machine.index(joint) for joint in log_set.joints]]
    found = accuse(log_set, intake.steps, without, signed, limit, workers, progress, earlier)
    checked = [f for f in measured(log_set, without) if earlier is None or (f.effect, f.joint) not in earlier.checked]
    compared = log_set.trials[0].trajectory.pressure_a is not None
    found = replace(found, causes=settle_offsets(found.causes, checked, compared))
    sensor = np.array([state.data.noise for state in found.states]) ** 2
    reasons, excited = shortage(found.base.fit, found.heldout, sensor)
    if reasons:
        warnings += reasons
        return Diagnosis(not_identifiable(log_set, warnings, LONGER, earlier, intake.left_out))
    joints = log_set.joints
    trials = [trial.trajectory for trial in log_set.fit]
    drawn = by_speed(trials, [state.data.linear for state in found.states])[0]
    before = _look(found.base, found.floor, found, drawn)
    floor = np.minimum(found.floor, before.evidence.floor)
    after = _look(found.rest, floor, found, drawn)
    still = [joint for joint, moved in zip(joints, excited, strict=True) if not moved]
    if still:
        warnings.append(f"too little excitation to judge {', '.join(still)}")
    base = whole_machine(found.before, intake, machine, effort_limit)
    augmented = whole_machine(_simulated(found.after, found.states), intake, machine, effort_limit)
    if found.before.mode == MODE:
        warnings += plain_joints(intake, machine, augmented is not None)
    content = answer(
        log_set,
        signed,
        intake.window,
        found,
        scale_causes(checked, joints),
        (before.evidence, after.evidence),
        (before.explained, after.explained),
        (before.places, after.places),
        warnings,
        earlier,
        intake.left_out,
    )
    units = {joint: output_unit(log_set, joint) for joint in joints}
    if earlier is not None and content["verdict"] == "no_gap":
        held = persistence_error(found.heldout)
        unpredicted = [joint for joint, e, h in zip(joints, before.evidence.error, held, strict=True) if e >= BLIND * h]
        content, reason = by_levels(content, earlier.levels, levels_of(signed.raw), unpredicted, units[joints[0]])
        if reason:
            return Diagnosis(not_identifiable(log_set, content["warnings"], ADVICE, earlier, intake.left_out))
    table = _table(before, after, found, units)
    traces = worst_windows(found.heldout, found.rest.heldout, log_set)
    models = [model and model.actuator() for model in (base, augmented)]
    return Diagnosis(content, tuple(table), traces, *models)


@dataclass(frozen=True, eq=False)
class Look:
    """The machine without or with the causes: its errors by regime, what explains them, what may be said, where."""

    sums: Tally
    explained: list[Explained]
    evidence: Evidence
    places: list[Place]


def _look(rest: Rest, floor: np.ndarray, found: Accusation, drawn: np.ndarray | float) -> Look:
    joints = rest.machine.joints
    explained = [rest.explained(j) for j in range(len(joints))]
    sums = tally(rest.heldout, drawn)
    evidence = weigh(sums, floor, explained, found.familiar)
    return Look(sums, explained, evidence, locate(sums, evidence.floor, joints, found.scale))


def _table(before: Look, after: Look, found: Accusation, units: Mapping[str, str]) -> list[Row]:
    """Rows of all trials together, then trial by trial; units: joint → unit of its output."""
    heldout = found.heldout
    held = dict(zip(heldout[0].trajectory.joints, np.sqrt(persistence_error(heldout)), strict=True))
    table = [
        replace(row, held=float(held[row.before.joint])) if row.before.family == ALL else row
        for row in _paired("all", before.places, after.places, units)
    ]
    for index, item in enumerate(heldout):
        parts = [(x.sums.of_trial(index), x.evidence.floor) for x in (before, after)]
        places = [locate(sums, floor, item.trajectory.joints, found.scale) for sums, floor in parts]
        table += _paired(item.file, *places, units)
    return table


def _paired(trial: str, before: list[Place], after: list[Place], units: Mapping[str, str]) -> list[Row]:
    known = {(p.joint, p.family, p.regime): p for p in after}
    return [Row(trial, p, known.get((p.joint, p.family, p.regime)), units[p.joint]) for p in before]


def _simulated(model: RowModel, states: Sequence[JointState]) -> RowModel:
    """The machine for the training simulator; a sensor whose gain changed since an earlier record is no part of it."""
    rows = model.rows.copy()
    for j, state in enumerate(states):
        if state.data.then is not None and SCALE in state.chosen.effects:
            rows[j] = multiplied(rows[j], SCALE, 1.0 / state.first_number(SCALE))
    return replace(model, rows=rows)


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.json, residuals.csv, traces.json and actuator.json; equal diagnoses give equal bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    validate_diagnosis(diagnosis.content)
    _write_json(folder / FILE, diagnosis.content, indent=2)
    if diagnosis.traces:
        _write_json(folder / TRACES, diagnosis.traces)
    if diagnosis.augmented is not None:
        save_actuator(diagnosis.augmented, folder)
    columns = ("joint", "family", "regime", "samples", "rmse", "share", "share_low", "share_high")
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        later = ("rmse_after", "share_after", HELD, "unit", "normalised", "normalised_after")
        writer.writerow(["trial", "joint", "family", "regime", "n", *columns[4:], *later])
        for row in diagnosis.table:
            values = asdict(row.before)
            after = [row.after.rmse, row.after.share] if row.after else ["", ""]
            after += ["" if row.held is None else row.held, row.unit, row.before.normalised]
            after.append(row.after.normalised if row.after else "")
            writer.writerow([row.trial, *(_cell(values[name]) for name in columns), *(_cell(v) for v in after)])


def _write_json(path: Path, content: Any, indent: int | None = None) -> None:
    path.write_text(json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def _cell(value: Any) -> Any:
    return f"{value:.6g}" if isinstance(value, float) else value


def errors_left(folder: Path) -> dict[str, float]:
    """Joint → held-out RMSE with the causes in the model, from residuals.csv; empty without that file or without causes."""
    path = folder / TABLE
    if not path.is_file():
        return {}
    rows = read_table(path, ("trial", "joint", "family", "rmse_after"), FIX)
    found = {row["joint"]: row["rmse_after"] for row in rows if (row["trial"], row["family"]) == ("all", "all")}
    return {joint: _number(path, text) for joint, text in found.items() if text}


def _number(path: Path, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(
            f"{path}: rmse_after: expected a number, got '{text[:40]}'", file=path, field="rmse_after", fix=FIX
        )
    return value
