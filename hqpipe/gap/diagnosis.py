"""The diagnosis of a log set: which layers answer, and what is said where two do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.diagnosis_files import FILE, TABLE, TRACES, Diagnosis, Row, errors_left, write_diagnosis
from hqpipe.gap.answer.head import not_identifiable
from hqpipe.gap.change.position_record import PositionRecord, position_record
from hqpipe.gap.change.since import EarlierLogs, EarlierModel
from hqpipe.gap.change.since_intake import only_known
from hqpipe.gap.intake import Intake, take_in
from hqpipe.gap.layer_diagnosis import apply_layer, diagnose_layer
from hqpipe.gap.layer_intake import layer_intake
from hqpipe.gap.position_layer import diagnose_position
from hqpipe.gap.routing import ACTUATOR, Route, route, route_since
from hqpipe.identify.identify import Progress
from hqpipe.logs.end_stops import Travel
from hqpipe.logs.trajectory import LogSet

__all__ = ["FILE", "LARGEST", "TABLE", "TRACES", "Diagnosis", "Row", "diagnose", "errors_left", "write_diagnosis"]

BLIND = 0.9  # of the squared error of holding the torque: a law that leaves more explains next to nothing; assumption
LARGEST = 3_800_000  # samples × joints in memory: 5 min of twelve joints at 1 kHz, which takes 1.5 GB


def diagnose(
    log_set: LogSet,
    *,
    window_s: float | None = None,
    without: Sequence[str] = (),
    effort_limit: np.ndarray | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    earlier: EarlierModel | EarlierLogs | None = None,
    travel: Travel | None = None,
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
        travel: stated limits of the joints' positions, where end stops may be.

    Raises:
        IdentificationError: no layer can be evaluated.
        UsageError: the record does not fit to the logs.
    """
    chosen = route_since(log_set) if isinstance(earlier, EarlierLogs) else route(log_set)
    if isinstance(earlier, EarlierModel):
        earlier.fits(log_set)
        chosen = Route(True)  # a model of the law from command to torque knows of no other layer
    elif earlier is not None:
        (earlier.fits if chosen.actuator else earlier.fits_layer)(log_set)
    name = next((name for name in chosen.layers if not apply_layer(name).lacking(log_set)), None)
    asked = _Question(window_s, without, workers, travel)
    if chosen.actuator:
        return _law_first(name, log_set, asked, effort_limit, progress, earlier)
    if name is None:
        return _lacking(log_set, chosen.layers, earlier)
    return _layer_alone(name, log_set, asked, progress, earlier)


@dataclass(frozen=True)
class _Question:
    """What `diagnose` was asked, of whichever layer answers; see there."""

    window_s: float | None
    without: Sequence[str]
    workers: int
    travel: Travel | None


def _law_first(
    name: str | None,
    log_set: LogSet,
    asked: _Question,
    effort_limit: np.ndarray | None,
    progress: Progress | None,
    earlier: EarlierModel | EarlierLogs | None,
) -> Diagnosis:
    """The answer of the law from command to torque, or that of layer `name` where that law does not hold."""
    record: PositionRecord | EarlierModel | None = None
    if isinstance(earlier, EarlierLogs):
        try:
            record = position_record(earlier, asked.window_s, asked.without, asked.travel)
        except IdentificationError:
            if name is None:
                raise
            return _layer_alone(name, log_set, asked, progress, earlier)
    elif earlier is not None:
        record = earlier
    intake = _taken_in(log_set, asked, record)
    first = diagnose_position(intake, log_set.joints, asked.without, effort_limit, asked.workers, progress, record)
    if name is None or intake.reasons or not errs_as_persistence(first):
        return first
    then = earlier if isinstance(earlier, EarlierLogs) else None
    try:
        second = _of_layer(name, intake, asked, progress, then)
    except IdentificationError as error:
        return _with_warnings(first, [f"layer {name}: {error}"])
    return _in_its_place(first, second)


def _taken_in(log_set: LogSet, asked: _Question, record: PositionRecord | EarlierModel | None) -> Intake:
    """The log set looked through, in windows as long as those of an earlier record, without joints that this does not know."""
    window_s = asked.window_s
    if isinstance(record, PositionRecord) and window_s is None:
        window_s = record.joints.window_s
    intake = take_in(log_set, window_s, asked.without, asked.travel)
    if isinstance(record, PositionRecord):
        if asked.window_s is None:
            intake = replace(intake, window=replace(intake.window, reason="as long as those of the reference"))
        known, path = record.intake.log_set.joints, str(record.logs.log_set.path)
        intake = only_known(intake, known, path)
    return intake if record is None else replace(intake, warnings=(*intake.warnings, *record.warnings))


def _of_layer(
    name: str, intake: Intake, asked: _Question, progress: Progress | None, earlier: EarlierLogs | None
) -> Diagnosis:
    """The answer of a layer to logs that were looked through for the law from command to torque."""
    return diagnose_layer(
        name,
        intake.signed.raw,
        asked.window_s,
        asked.without,
        asked.workers,
        progress,
        earlier,
        left_out=list(intake.left_out),
        warnings=list(intake.warnings),
    )


def _layer_alone(
    name: str, log_set: LogSet, asked: _Question, progress: Progress | None, earlier: EarlierLogs | None
) -> Diagnosis:
    """The answer of a layer, its logs looked through as far as their channels allow."""
    intake = layer_intake(name, log_set, asked.without, asked.travel)
    if intake.reasons:
        return Diagnosis(
            not_identifiable(intake.log_set, list(intake.warnings), intake.advice, earlier, intake.left_out)
        )
    rest = {"left_out": list(intake.left_out), "warnings": list(intake.warnings)}
    return diagnose_layer(name, intake.log_set, asked.window_s, asked.without, asked.workers, progress, earlier, **rest)


def errs_as_persistence(found: Diagnosis) -> bool:
    """Whether the law of the actuator layer, its effects included, errs as much as holding the output."""
    if found.law is None:
        return found.content["verdict"] == "not_identifiable"
    size = found.law["normalised"]
    return size["after"] ** 2 >= BLIND * size["persistence"] ** 2


def _in_its_place(first: Diagnosis, second: Diagnosis) -> Diagnosis:
    """The answer of a layer where the law of the actuator does not hold, with the gap of both."""
    if second.content["gap"] is None:
        told = first.content["warnings"]
        return _with_warnings(first, [text for text in second.content["warnings"] if text not in told])
    law = [first.law] if first.law is not None else []
    content = second.content | {"gaps": [second.content["gap"], *law]}
    return _with_warnings(replace(second, content=content), [_no_law(law, second.content["gap"]["layer"])], first=True)


def _no_law(law: Sequence[dict[str, Any]], layer: str) -> str:
    if not law:
        return f"layer {ACTUATOR}: the law from command to torque cannot be told from these logs; the answer is that of {layer}"
    size = law[0]["normalised"]
    return (
        f"the law from command to torque (layer {ACTUATOR}) errs by {size['after']:.0%} of the joints' spread even with its "
        f"effects, holding the torque by {size['persistence']:.0%}: it is not the law of this machine, so that the answer is "
        f"that of layer {layer}"
    )


def _with_warnings(found: Diagnosis, more: Sequence[str], first: bool = False) -> Diagnosis:
    told = found.content["warnings"]
    return replace(found, content=found.content | {"warnings": [*more, *told] if first else [*told, *more]})


def _lacking(log_set: LogSet, layers: Sequence[str], earlier: EarlierLogs | None) -> Diagnosis:
    """The answer where no layer has what it needs."""
    lacking = {name: apply_layer(name).lacking(log_set) for name in layers}
    warnings = [*log_set.warnings, *(f"layer {name} needs {', '.join(what)}" for name, what in lacking.items())]
    return Diagnosis(not_identifiable(log_set, warnings, "record what is missing", earlier))
