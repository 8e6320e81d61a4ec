"""The content of a diagnosis and its files: diagnosis.json, residuals.csv, traces.json, actuator.json, posterior.json."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.posterior import Posterior
from hqpipe.actuators.posterior_file import save_posterior
from hqpipe.errors import ConfigError
from hqpipe.files.documents import read_table
from hqpipe.gap.answer.schema import FIX, validate_diagnosis
from hqpipe.gap.residuals.locate import Place

FILE, TABLE, TRACES = "diagnosis.json", "residuals.csv", "traces.json"
HELD = "rmse_persistence"


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
        content: JSON-able, valid against `hqpipe.gap.answer.schema`.
        table: joint × regime.
        traces: measured and predicted torque round the worst window of each joint.
        base, augmented: the actuator model of all joints without and with the effects found, those that were left out
            without any; None outside position mode, or where a joint has no sound logs.
        posterior: of the parameters of `augmented`; None without it, and beside an earlier record.
        law: gap of the actuator layer as in diagnosis.json, also where the content has none because nothing can be said of it.
    """

    content: dict[str, Any]
    table: tuple[Row, ...] = ()
    traces: dict[str, Any] = field(default_factory=dict)
    base: ActuatorModel | None = None
    augmented: ActuatorModel | None = None
    posterior: Posterior | None = None
    law: dict[str, Any] | None = None

    @property
    def verdict(self) -> str:
        return self.content["verdict"]


def write_diagnosis(diagnosis: Diagnosis, folder: Path) -> None:
    """Write diagnosis.json, residuals.csv, traces.json, actuator.json and posterior.json; equal diagnoses give equal bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    validate_diagnosis(diagnosis.content)
    _write_json(folder / FILE, diagnosis.content, indent=2)
    if diagnosis.traces:
        _write_json(folder / TRACES, diagnosis.traces)
    if diagnosis.augmented is not None:
        save_actuator(diagnosis.augmented, folder)
    if diagnosis.posterior is not None:
        save_posterior(diagnosis.posterior, diagnosis.augmented, folder)
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
