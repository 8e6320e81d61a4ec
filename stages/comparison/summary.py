"""What compare shows of its comparison.json: figures, tables for the terminal, and a headline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

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
    """reward_curves.png, and plant.png where a policy walked; `output` has the folders of the trainings."""
    from hqpipe.report.controller_figures import plant_panels, reward_curves

    runs = {
        each["title"]: [
            output / training["folder"] / METRICS for training in each["trainings"] if training["reward"] is not None
        ]
        for each in report["controllers"]
    }
    if any(runs.values()):
        reward_curves(runs, output / "reward_curves.png")
    if cells := list(_cells(report)):
        plant_panels(cells, _short(report), output / "plant.png")


def tables(report: Report, speeds: Mapping[str, Mapping[str, float]]) -> list[Any]:
    """Tables and lines; `speeds` is folder of a training → training_s and steps_per_second."""
    from hqpipe.report.controller_table import loop_lines, plant_table, scenario_table, training_table

    rows = [_row(each) for each in report["controllers"]]
    taken = {each["title"]: _taken(each["trainings"], speeds) for each in report["controllers"]}
    found = [training_table(rows, {title: speed for title, speed in taken.items() if speed})]
    if cells := list(_cells(report)):
        found.append(plant_table(rows))
        if len({cell["scenario"] for cell in cells}) > 1:
            found.append(scenario_table(cells, _short(report)))
    diverged = [
        f"warning: {training['folder']} after {training['iterations']} iterations: {training['diverged']}"
        for each in report["controllers"]
        for training in each["trainings"]
        if training["diverged"]
    ]
    return [*found, *diverged, *loop_lines(report["loop"])]


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
    return {key: _mean([speed[key] for speed in known]) for key in ("training_s", "steps_per_second")}


def _cells(report: Report) -> Iterator[dict[str, Any]]:
    """A mapping per controller, actor and scenario, all seeds of the trainings together."""
    from hqpipe.stages.comparison.results import pooled, walks

    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in walks(report["trials"]):
        groups.setdefault((row["scenario"], row["controller"], row["actor"]), []).append(row)
    for (scenario, controller, actor), rows in groups.items():
        yield {"scenario": scenario, "controller": controller, "actor": actor, **pooled(rows)}


def _short(report: Report) -> dict[str, str]:
    """Controller → the end of its title, where seven must stand side by side."""
    return {each["controller"]: each["title"].rsplit(", ", 1)[1] for each in report["controllers"]}


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
