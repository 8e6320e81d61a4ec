"""What compare shows of its comparison.json: figures, tables for the terminal, and a headline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hqpipe.stages.comparison.controllers import ORACLE, STIFF, TITLES
from hqpipe.stages.comparison.oracle import LEFT_OUT
from hqpipe.stages.comparison.plant import POLICY
from hqpipe.stages.inputs.training import METRICS

Report = Mapping[str, Any]


def headline(report: Report) -> str:
    """How many walks of each controller fell on the plant."""
    falls = []
    for each in report["controllers"]:
        found = (each["plant"] or {}).get(POLICY)
        falls.append(f"{each['controller']} {found['falls'] if found else 'diverged'}")
    walks = max((each["plant"][POLICY]["walks"] for each in report["controllers"] if each["plant"]), default=0)
    return f"falls on the plant, of {walks}: {', '.join(falls)}"


def draw(output: Path, report: Report) -> None:
    """learning_curves.png, and plant.png where a policy walked; `output` has the folders of the trainings."""
    from hqpipe.report.controller_figures import learning_curves, plant_panels

    short = _short(report)
    runs = {
        short[each["controller"]]: [
            output / training["folder"] / METRICS for training in each["trainings"] if training["reward"] is not None
        ]
        for each in report["controllers"]
    }
    if any(runs.values()):
        learning_curves(runs, output / "learning_curves.png")
    if cells := list(_cells(report)):
        plant_panels(cells, short, output / "plant.png")


def tables(report: Report, speeds: Mapping[str, Mapping[str, float]]) -> list[Any]:
    """Tables and lines; `speeds` is folder of a training → training_s and step_s, s."""
    from hqpipe.report.controller_table import (
        check_lines,
        difference_table,
        loop_lines,
        plant_table,
        scenario_table,
        seeds_table,
        training_table,
    )

    rows = [_row(each) for each in report["controllers"]]
    taken = {each["title"]: _taken(each["trainings"], speeds) for each in report["controllers"]}
    found = [training_table(rows, {title: speed for title, speed in taken.items() if speed})]
    if cells := list(_cells(report)):
        found.append(plant_table(rows))
        if len({cell["scenario"] for cell in cells}) > 1:
            found.append(scenario_table(cells, _short(report)))
        found += _over_seeds(report, seeds_table, difference_table)
    diverged = [
        f"warning: {training['folder']} after {training['iterations']} iterations: {training['diverged']}"
        for each in report["controllers"]
        for training in each["trainings"]
        if training["diverged"]
    ]
    return [*found, *diverged, *_check(report, check_lines), *loop_lines(report["loop"])]


def _over_seeds(report: Report, seeds_table: Any, difference_table: Any) -> Iterator[Any]:
    """The table of the seeds where there are two, and that of the differences from the controller without a model."""
    rows = {each["title"]: each["over_seeds"] for each in report["controllers"] if each["plant"]}
    if any(found["ci95"] for row in rows.values() for found in row.values() if found):
        yield seeds_table(rows)
    against = {each["title"]: each[f"against_{STIFF}"] for each in report["controllers"]}
    if any(against.values()):
        yield difference_table({title: row for title, row in against.items() if row}, TITLES[STIFF])


def _check(report: Report, check_lines: Any) -> list[str]:
    if not report["model_check"]:
        return []
    (oracle,) = (each["effects"] for each in report["controllers"] if each["controller"] == ORACLE)
    return check_lines(report["model_check"], oracle, LEFT_OUT)


def _row(each: Report) -> dict[str, Any]:
    """One controller, its trainings taken together."""
    finished = [training for training in each["trainings"] if not training["diverged"]]
    rewards = [training["reward"] for training in each["trainings"] if training["reward"] is not None]
    kinds = {"policy": "policy", "zero_action": "zero_action_baseline"}
    return {
        "title": each["title"],
        "reward": _mean(rewards) if rewards else None,
        "simulator": {actor: _judged([t[key] for t in finished]) for actor, key in kinds.items()} if finished else None,
        "plant": each["plant"],
        "note": _randomised(finished[0]["actuator_randomisation"]) if finished else "diverged",
    }


def _judged(evaluations: Sequence[Report]) -> dict[str, float]:
    """Of several evaluations in the simulator."""
    return {
        "falls": sum(each["falls"] for each in evaluations),
        "walks": sum(each["robots"] for each in evaluations),
        "score": _mean([each["score"] for each in evaluations]),
    }


def _randomised(report: Report) -> str:
    if report["mode"] == "half_range":
        return f"within ±{100.0 * report['half_range']:g} %"
    return {"posterior": "drawn from the posterior", "none": "all alike"}[report["mode"]]


def _taken(trainings: Sequence[Report], speeds: Mapping[str, Mapping[str, float]]) -> dict[str, float] | None:
    """Means over the seeds."""
    known = [speeds[training["folder"]] for training in trainings if training["folder"] in speeds]
    if not known:
        return None
    return {key: _mean([speed[key] for speed in known]) for key in ("training_s", "step_s")}


def _cells(report: Report) -> Iterator[dict[str, Any]]:
    """A mapping per controller, actor and scenario, all seeds of the trainings together."""
    from hqpipe.stages.comparison.results import pooled, walks

    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in walks(report["trials"]):
        groups.setdefault((row["scenario"], row["controller"], row["actor"]), []).append(row)
    for (scenario, controller, actor), rows in groups.items():
        yield {"scenario": scenario, "controller": controller, "actor": actor, **pooled(rows)}


def _short(report: Report) -> dict[str, str]:
    """Controller → the end of its title, where eight must stand side by side."""
    return {each["controller"]: each["title"].rsplit(", ", 1)[1] for each in report["controllers"]}


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
