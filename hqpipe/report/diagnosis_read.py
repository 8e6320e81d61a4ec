"""The files of a diagnosis as a report needs them: what is optional may be absent, what is there must be sound."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError

CONTENT, TABLE, TRACES, MODEL = "diagnosis.json", "residuals.csv", "traces.json", "actuator.json"
FORMAT = "hqpipe-diagnosis/1"
_SERIES = ("measured", "before", "after", "command", "position")


@dataclass(frozen=True)
class Cell:
    """One row of residuals.csv: a joint in a regime of a family.

    Attributes:
        samples: how many samples the place holds.
        rmse, rmse_after: in the unit of the gap; None where not given.
        share, share_low, share_high: of the gap, 0…1, with its 95 % interval.
        share_after: of what is left of the gap once the found effects are added.
    """

    joint: str
    family: str
    regime: str
    samples: float
    share: float
    share_low: float | None
    share_high: float | None
    rmse: float | None
    rmse_after: float | None
    share_after: float | None


@dataclass(frozen=True)
class Trace:
    """The stretch round a joint's worst held-out window.

    Attributes:
        time: (T,) s. restarts: s, where the model was restarted from the log.
        series: measured, before, after, command, position as far as given, (T,) each.
    """

    joint: str
    trial: str
    time: list[float]
    restarts: list[float]
    series: dict[str, list[float | None]]


@dataclass(frozen=True)
class DiagnosisFiles:
    """What a diagnosis folder holds.

    Attributes:
        content: diagnosis.json.
        cells: residuals.csv, the pooled trial only; empty without the file.
        traces: traces.json; empty without the file.
        trace_unit: of measured, before and after; that of the gap where traces.json does not say.
        has_model: whether the folder holds the model with the found effects.
    """

    content: dict[str, Any]
    cells: tuple[Cell, ...]
    traces: tuple[Trace, ...]
    trace_unit: str
    has_model: bool


def read_files(folder: Path) -> DiagnosisFiles:
    """Read the files of a diagnosis.

    Raises:
        UsageError: there is no diagnosis.json, or a file is not what its name says.
    """
    content = _read_json(folder / CONTENT, f"expected a folder that `hqpipe diagnose` wrote, such as {folder}")
    if content.get("format") != FORMAT:
        raise UsageError(f"{folder / CONTENT}: format: expected {FORMAT}, got {content.get('format')!r}")
    cells = _read_cells(folder / TABLE) if (folder / TABLE).exists() else ()
    traces, unit = _read_traces(folder / TRACES) if (folder / TRACES).exists() else ((), "")
    unit = unit or (content["gap"] or {}).get("unit", "")
    return DiagnosisFiles(content, cells, traces, unit, (folder / MODEL).exists())


def _read_json(path: Path, mend: str) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise UsageError(f"{path}: no such file; {mend}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not JSON ({error}); run `hqpipe diagnose` again") from error
    if not isinstance(value, dict):
        raise UsageError(f"{path}: expected an object, got {type(value).__name__}; run `hqpipe diagnose` again")
    return value


def _read_cells(path: Path) -> tuple[Cell, ...]:
    with path.open(newline="", encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row.get("trial") == "all"]
    cells = []
    for number, row in enumerate(rows, start=1):
        try:
            names = {key: row[key] for key in ("joint", "family", "regime")}
            share, samples = float(row["share"]), float(row["n"])
        except (KeyError, TypeError, ValueError) as error:
            raise UsageError(
                f"{path}: row {number} of the trial 'all': expected joint, family, regime and the numbers n and "
                f"share ({error}); run `hqpipe diagnose` again"
            ) from error
        rest = ("share_low", "share_high", "rmse", "rmse_after", "share_after")
        optional = {key: _optional(row.get(key), path, key) for key in rest}
        cells.append(Cell(**names, share=share if math.isfinite(share) else 0.0, samples=samples, **optional))
    return tuple(cells)


def _optional(text: str | None, path: Path, column: str) -> float | None:
    """A number, or None where the column or the cell is empty."""
    if not text:
        return None
    try:
        value = float(text)
    except ValueError as error:
        raise UsageError(f"{path}: column {column}: expected a number, got {text!r}") from error
    return value if math.isfinite(value) else None


def _read_traces(path: Path) -> tuple[tuple[Trace, ...], str]:
    raw = _read_json(path, "run `hqpipe diagnose` again")
    if not isinstance(raw.get("joints"), dict):
        raise UsageError(f"{path}: joints: expected an object, got {type(raw.get('joints')).__name__}")
    return tuple(_trace(path, joint, entry) for joint, entry in raw["joints"].items()), str(raw.get("unit", ""))


def _trace(path: Path, joint: str, entry: Mapping[str, Any]) -> Trace:
    for name in ("time", "measured", "before"):
        if not isinstance(entry.get(name), list):
            raise UsageError(f"{path}: joints.{joint}.{name}: missing, expected a list of numbers")
    series = {name: entry[name] for name in _SERIES if isinstance(entry.get(name), list)}
    for name, values in series.items():
        if len(values) != len(entry["time"]):
            raise UsageError(
                f"{path}: joints.{joint}.{name}: expected {len(entry['time'])} numbers as in time, got {len(values)}"
            )
    return Trace(joint, str(entry.get("trial", "")), entry["time"], list(entry.get("restarts", [])), series)
