"""The actuator layer: the law from a command to the torque that it makes, its error and what explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.gap.accuse import Accusation, accuse
from hqpipe.gap.answer import answer, not_identifiable
from hqpipe.gap.changes import SCALE, multiplied
from hqpipe.gap.diagnosis_files import Diagnosis, Row
from hqpipe.gap.gap_entry import output_unit
from hqpipe.gap.intake import LONGER, Intake, take_in
from hqpipe.gap.joint_data import by_speed
from hqpipe.gap.joint_state import JointState, Progress
from hqpipe.gap.left_joints import plain_joints, whole_machine
from hqpipe.gap.level_answer import ADVICE, by_levels
from hqpipe.gap.levels import BLIND, levels_of
from hqpipe.gap.locate import Place, locate
from hqpipe.gap.reference import Explained
from hqpipe.gap.replay import persistence_error
from hqpipe.gap.rest import Rest
from hqpipe.gap.row_model import RowModel
from hqpipe.gap.second_channel import measured, scale_causes, settle_offsets
from hqpipe.gap.since import MODE, Earlier
from hqpipe.gap.since_intake import only_known
from hqpipe.gap.tally import ALL, Tally, tally
from hqpipe.gap.traces import worst_windows
from hqpipe.gap.verdict import Evidence, shortage, weigh
from hqpipe.logs.end_stops import Travel
from hqpipe.logs.trajectory import LogSet


def intake_of(
    log_set: LogSet,
    window_s: float | None,
    without: Sequence[str] = (),
    earlier: Earlier | None = None,
    travel: Travel | None = None,
) -> Intake:
    """The log set looked through, with the windows of `earlier` logs and without joints that these do not know.

    Raises:
        UsageError: the record does not fit to the logs.
    """
    if earlier is not None:
        earlier.fits(log_set)
    if window_s is None and earlier is not None and earlier.window_s is not None:
        intake = take_in(log_set, earlier.window_s, without, travel)
        intake = replace(intake, window=replace(intake.window, reason="as long as those of the reference"))
    else:
        intake = take_in(log_set, window_s, without, travel)
    if earlier is not None:
        intake = only_known(intake, earlier)
        intake = replace(intake, warnings=(*intake.warnings, *earlier.warnings))
    return intake


def diagnose_actuator(
    intake: Intake,
    machine: tuple[str, ...],
    without: Sequence[str] = (),
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    earlier: Earlier | None = None,
) -> Diagnosis:
    """The answer of the actuator layer for the joints that are left.

    Args:
        intake: of the logs. machine: joints of the logs as they came; `effort_limit` is of these. The others are as in
            `hqpipe.gap.diagnosis.diagnose`.
    """
    if intake.reasons:
        warnings = [*intake.warnings, *intake.stops]
        return Diagnosis(not_identifiable(intake.log_set, warnings, intake.advice, earlier, intake.left_out))
    log_set, signed, warnings = intake.log_set, intake.signed, [*intake.warnings, *intake.stops]
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
    units, law = {joint: output_unit(log_set, joint) for joint in joints}, content["gap"]
    if earlier is not None and content["verdict"] == "no_gap":
        held = persistence_error(found.heldout)
        unpredicted = [joint for joint, e, h in zip(joints, before.evidence.error, held, strict=True) if e >= BLIND * h]
        content, reason = by_levels(content, earlier.levels, levels_of(signed.raw), unpredicted, units[joints[0]])
        if reason:
            refused = not_identifiable(log_set, content["warnings"], ADVICE, earlier, intake.left_out)
            return Diagnosis(refused, law=law)
    table = _table(before, after, found, units)
    traces = worst_windows(found.heldout, found.rest.heldout, log_set)
    models = [model and model.actuator() for model in (base, augmented)]
    return Diagnosis(content, tuple(table), traces, *models, law=law)


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
