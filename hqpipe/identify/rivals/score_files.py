"""The comparison as plain data: long rows for a CSV file, and a tree for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

from hqpipe.identify.rivals.compare import ALL, ScoreRow

NOISE_FLOOR = "noise floor"
HORIZONS = ("one_step", "free_run")
_UNITS = {"rmse": "N·m", "nrmse": "1", "loaded_rmse": "N·m", "loaded_mape": "%"}


def long_rows(rows: Sequence[ScoreRow]) -> list[dict[str, Any]]:
    """One number a row: logs, trial, joint, model, horizon, measure, unit, value; a measure that does not exist is left out.

    The noise floor stands among the models, once for each of logs, trial and joint.
    """
    found: list[dict[str, Any]] = []
    seen = set()
    for row in rows:
        place = {"logs": row.logs, "trial": row.trial, "joint": row.joint}
        if (key := tuple(place.values())) not in seen:
            seen.add(key)
            floor = {"model": NOISE_FLOOR, "horizon": "any", "measure": "rmse", "unit": "N·m"}
            found.append({**place, **floor, "value": row.noise_floor})
        for horizon in HORIZONS:
            measures = {**asdict(getattr(row, horizon)), "skill": getattr(row, f"{horizon}_skill")}
            for measure, unit in (*_UNITS.items(), ("skill", "1")):
                if measures[measure] is not None:
                    head = {"model": row.model, "horizon": horizon, "measure": measure, "unit": unit}
                    found.append({**place, **head, "value": measures[measure]})
    return found


def score_tree(rows: Sequence[ScoreRow], window_s: float) -> dict[str, Any]:
    """JSON-able: logs → noise floors, and model → errors over all of it, by trial and by joint; null where it diverged."""
    logs: dict[str, Any] = {}
    for row in rows:
        tree = logs.setdefault(row.logs, {"noise_floor": {}, "models": {}})
        part = "all" if row.joint == row.trial == ALL else "joints" if row.trial == ALL else "trials"
        name = row.trial if part == "trials" else row.joint
        if part == "all":
            tree["noise_floor"]["all"] = row.noise_floor
            tree["models"].setdefault(row.model, {})["all"] = _errors(row)
        else:
            tree["noise_floor"].setdefault(part, {})[name] = row.noise_floor
            tree["models"].setdefault(row.model, {}).setdefault(part, {})[name] = _errors(row)
    return {"window_s": window_s, "logs": logs}


def _errors(row: ScoreRow) -> dict[str, Any]:
    return {
        horizon: {
            name: finite(value)
            for name, value in {**asdict(getattr(row, horizon)), "skill": getattr(row, f"{horizon}_skill")}.items()
        }
        for horizon in HORIZONS
    }


def finite(value: float | None) -> float | None:
    """The number, or None where a model diverged: JSON has no infinity."""
    return value if value is not None and isfinite(value) else None
