"""What the walks of compare add up to: per controller, per scenario, and against the controller trained without a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.controllers import DIAGNOSED, FITTED, ORACLE, STIFF
from hqpipe.stages.comparison.plant import POLICY

# Measures of `hqpipe.rl.walk_columns.walk_measures` that controllers are compared by.
MEASURES = (
    "velocity_error",
    "yaw_error",
    "drift",
    "foot_clearance",
    "peak_force",
    "force_p99",
    "tracking_rmse",
    "torque_rmse",
    "torque_saturation",
)
_GAP = ("layer", "metric", "unit", "before", "after", "noise_floor", "shrink", "shrink_ci95")
Rows = Sequence[Mapping[str, Any]]


def walks(trials: Rows) -> Iterator[dict[str, Any]]:
    """One flat row per walk, of the results of `walk_all`."""
    for trial in trials:
        head = {key: trial[key] for key in ("controller", "training_seed", "actor", "scenario")}
        for walk in trial["seeds"]:
            measures = {key: value for key, value in walk.items() if key != "seed"}
            yield {**head, "walk_seed": walk["seed"], **measures}


def pooled(rows: Rows) -> dict[str, Any]:
    """walks and falls, counts; mean of each measure over the walks that did not fall, None where none tells it."""
    upright = [row for row in rows if not row["fell"]]
    means = {name: _mean([row.get(name) for row in upright]) for name in MEASURES}
    return {"walks": len(rows), "falls": len(rows) - len(upright), **means}


def by_controller(rows: Rows) -> dict[str, dict[str, Any]]:
    """Controller → actor → `pooled` over all scenarios."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(row["controller"], {}).setdefault(row["actor"], []).append(row)
    return {name: {actor: pooled(each) for actor, each in actors.items()} for name, actors in found.items()}


def loop_closed(rows: Rows, diagnosis: Path | None) -> dict[str, Any]:
    """The gap before and after, beside what a policy trained with the model does better on the plant than one without.

    Args:
        rows: of `walks`. diagnosis: folder with diagnosis.json, if there is one.

    Returns:
        gap, as in diagnosis.json, None where none was measured; since_reference, whether it is about a change of the machine;
        against, the controller without a model; controllers: name → `_against`.
    """
    content = _diagnosed(diagnosis / "diagnosis.json") if diagnosis else {}
    gap = content.get("gap")
    policies = [row for row in rows if row["actor"] == POLICY]
    names = {row["controller"] for row in policies}
    return {
        "gap": {key: gap[key] for key in (*_GAP, "normalised") if key in gap} if gap else None,
        "since_reference": "reference" in content,
        "against": STIFF,
        "controllers": {
            name: _against(policies, name) for name in (FITTED, DIAGNOSED, ORACLE) if name in names and STIFF in names
        },
    }


def _diagnosed(path: Path) -> dict[str, Any]:
    """diagnosis.json, whose gap, if there is one, has what is shown of it."""
    from hqpipe.files.documents import read_json
    from hqpipe.files.entries import Entry

    fix = "run hqpipe diagnose again"
    document = Entry(read_json(path, fix), path, fix)
    gap = document.table().get("gap")
    fields = gap.or_none(Entry.table) if gap is not None else None
    if fields and (missing := [name for name in _GAP if name not in fields]):
        raise gap.error(f"missing field '{missing[0]}'")
    return document.value


def _against(rows: Rows, name: str) -> dict[str, Any]:
    """falls of both, [without, with the model]; walks of each; pairs: same scenario, same seeds, and neither fell; over those
    the mean of every measure, [without, with the model]."""
    keyed = [
        {(row["scenario"], row["training_seed"], row["walk_seed"]): row for row in rows if row["controller"] == which}
        for which in (STIFF, name)
    ]
    common = [key for key in keyed[0] if key in keyed[1]]
    pairs = [[each[key] for each in keyed] for key in common if not any(each[key]["fell"] for each in keyed)]
    measures = {}
    for measure in MEASURES:
        told = [[row.get(measure) for row in pair] for pair in pairs]
        told = [pair for pair in told if None not in pair]
        measures[measure] = [_mean(side) for side in zip(*told, strict=True)] if told else None
    return {
        "falls": [sum(each[key]["fell"] for key in common) for each in keyed],
        "walks": len(common),
        "pairs": len(pairs),
        "measures": measures,
    }


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
