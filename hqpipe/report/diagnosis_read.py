"""The files of a diagnosis as a report needs them: what is optional may be absent, what is there must be sound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError
from hqpipe.files.documents import read_json, read_table
from hqpipe.files.entries import Entry

CONTENT, TABLE, TRACES, MODEL = "diagnosis.json", "residuals.csv", "traces.json", "actuator.json"
FORMATS = ("hqpipe-diagnosis/2", "hqpipe-diagnosis/1")
_FIX = "run `hqpipe diagnose` again, or give a folder that it wrote"
_SERIES = ("measured", "before", "after", "command", "position")


@dataclass(frozen=True)
class Cell:
    """One row of residuals.csv: a joint in a regime of a family.

    Attributes:
        samples: how many samples the place holds.
        rmse, rmse_after: in `unit`, that of the gap where the file does not say; None where not given.
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
    unit: str = ""


@dataclass(frozen=True)
class Trace:
    """The stretch round a joint's worst held-out window.

    Attributes:
        time: (T,) s. restarts: s, where the model was restarted from the log.
        series: measured, before, after, command, position as far as given, (T,) each.
        unit: of measured, before and after; that of the gap where traces.json does not say.
    """

    joint: str
    trial: str
    time: list[float]
    restarts: list[float]
    series: dict[str, list[float | None]]
    unit: str


@dataclass(frozen=True)
class DiagnosisFiles:
    """What a diagnosis folder holds.

    Attributes:
        content: diagnosis.json.
        cells: residuals.csv, the pooled trial only; empty without the file.
        traces: traces.json; empty without the file.
        has_model: whether the folder holds the model with the found effects.
    """

    content: dict[str, Any]
    cells: tuple[Cell, ...]
    traces: tuple[Trace, ...]
    has_model: bool


def read_files(folder: Path) -> DiagnosisFiles:
    """Read the files of a diagnosis.

    Raises:
        UsageError: there is no diagnosis.json, or a file is not what its name says.
    """
    content = _document(folder / CONTENT)
    content.inner("format").text(FORMATS)
    gap = content.inner("gap").or_none(Entry.table) or {}
    unit = (gap["unit"].or_none(Entry.text) if "unit" in gap else None) or ""
    cells = _read_cells(folder / TABLE, unit) if (folder / TABLE).exists() else ()
    traces = _read_traces(folder / TRACES, unit) if (folder / TRACES).exists() else ()
    return DiagnosisFiles(content.value, cells, traces, (folder / MODEL).exists())


def _document(path: Path) -> Entry:
    document = Entry(read_json(path, _FIX, UsageError), path, _FIX, kind=UsageError)
    document.table()
    return document


def _read_cells(path: Path, unit: str) -> tuple[Cell, ...]:
    rows = read_table(path, ("trial", "joint", "family", "regime", "n", "share"), _FIX, UsageError)
    cells = []
    for row in (row for row in rows if row["trial"] == "all"):
        names = {key: row[key] for key in ("joint", "family", "regime")}
        share, samples = (_number(row, key, path) for key in ("share", "n"))
        rest = ("share_low", "share_high", "rmse", "rmse_after", "share_after")
        optional = {key: _optional(row, key, path) for key in rest}
        share = share if math.isfinite(share) else 0.0
        cells.append(Cell(**names, share=share, samples=samples, **optional, unit=row.get("unit") or unit))
    return tuple(cells)


def _number(row: dict[str, str], column: str, path: Path) -> float:
    try:
        return float(row[column])
    except ValueError as error:
        raise UsageError(
            f"{path}: column {column}: expected a number, got {row[column][:40]!r}", file=path, field=column, fix=_FIX
        ) from error


def _optional(row: dict[str, str], column: str, path: Path) -> float | None:
    """A number, or None where the column or the cell is empty."""
    if not row.get(column):
        return None
    value = _number(row, column, path)
    return value if math.isfinite(value) else None


def _read_traces(path: Path, unit: str) -> tuple[Trace, ...]:
    top = _document(path).table()
    if "joints" not in top:
        raise UsageError(f"{path}: missing field 'joints'", file=path, field="joints", fix=_FIX)
    unit = top["unit"].text() if "unit" in top else unit
    return tuple(_trace(joint, entry, unit) for joint, entry in top["joints"].table().items())


def _trace(joint: str, entry: Entry, unit: str) -> Trace:
    fields = entry.table()
    for name in ("time", "measured", "before"):
        if name not in fields:
            raise entry.error(f"missing field '{name}'")
    time = fields["time"].numbers(None)
    series = {
        name: [item.or_none(Entry.number) for item in fields[name].items(len(time), len(time))]
        for name in _SERIES
        if name in fields and fields[name].value is not None
    }
    trial = fields["trial"].text() if "trial" in fields else ""
    restarts = fields["restarts"].numbers(None) if "restarts" in fields else []
    return Trace(joint, trial, time, restarts, series, fields["unit"].text() if "unit" in fields else unit)
