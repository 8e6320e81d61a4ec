"""validate: the gate before a policy goes on the machine."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import AfterValidator

from hqpipe.pipeline.config import StageParams
from hqpipe.stages.inputs.bounds import Threshold, TrialSeconds, Walks, within
from hqpipe.stages.inputs.plant_overrides import Plant
from hqpipe.stages.walks.scenarios import SCENARIOS, Scenario, known_scenarios, run_scenarios

_SHOWN = "forward_10"  # in walk.png, or else the first scenario
_WORDS = {
    "falls": "falls",
    "drift": "drift, m",
    "speed_error": "speed error, m/s",
    "yaw_error": "error of the turning rate, rad/s",
}


class Params(StageParams):
    """Thresholds, and the walks of the exported policy on the plant.

    Attributes:
        torque_nrmse: largest free-running torque error on held-out trials, over the torque's standard deviation.
        parity_rad: largest difference between ONNX Runtime and torch, rad.
        latency_us: largest median time of one call, µs; the policy has 10 ms.
        scenarios: names of the trials on the plant, see `hqpipe.stages.walks.scenarios`.
        walk_seeds: how many walks of each. walk_seconds: longest walk, s; shortens the scenarios.
        walk_falls: how many walks of a scenario may fall.
        walk_speed_error: largest error of a walk's mean speed, m/s. walk_drift: largest distance from its course, m.
        walk_yaw_error: largest error of the mean rate of a turn, rad/s. All three of the walks that do not fall;
            `hqpipe.stages.walks.scenarios` says where more is granted, or less.
        plant: as in collect. strict: as in fit-actuator.
    """

    torque_nrmse: Threshold = 0.35
    parity_rad: Threshold = 1e-4
    latency_us: Threshold = 1000.0
    scenarios: Annotated[list[str], AfterValidator(known_scenarios)] = list(SCENARIOS)
    walk_seeds: Walks = 4
    walk_seconds: TrialSeconds | None = None
    walk_falls: Annotated[int, within(0, 1000, "as many as there are walks")] = 0
    walk_speed_error: Threshold = 0.05
    walk_drift: Threshold = 1.0
    walk_yaw_error: Threshold = 0.05
    plant: Plant = {}
    strict: bool = False


Check = tuple[str, float | None, float]  # what, value, limit; a value of None is a missed check


def run(context: Any) -> dict[str, Any]:
    from hqpipe.report.tables import scenario_table
    from hqpipe.rl.onnx_session import latency
    from hqpipe.stages.output.figures import draw_walk
    from hqpipe.stages.output.terminal import show

    p = context.params
    torque = _torque_error(context)
    shown = _SHOWN if _SHOWN in p.scenarios else p.scenarios[0]
    rows = run_scenarios(
        context.inputs["onnx"],
        context.robot,
        p.scenarios,
        p.walk_seeds,
        1000 * context.seed + 500,  # apart from those of collect, so that no walk repeats one that was logged
        p.plant,
        context.workers,
        context.progress,
        seconds=p.walk_seconds,
        shown=(shown,),
    )
    for row in rows:
        row["limits"] = walk_limits(SCENARIOS[row["scenario"]], p)
        if row["scenario"] == shown:
            draw_walk(context.output, shown, row.pop("columns"), context.robot)
    timing = latency(context.inputs["onnx"] / "policy.onnx")
    checks = [
        ("held-out torque error over its standard deviation", torque["nrmse"], p.torque_nrmse),
        ("difference to torch, rad", _parity(context), p.parity_rad),
        ("latency, µs", timing["median_us"], p.latency_us),
        *(check for row in rows for check in walk_checks(row)),
    ]
    failed = missed(checks)
    show(scenario_table(rows))
    # No timing, so that the bytes can be made again.
    report = {"torque": torque, "scenarios": rows, "failed": [what for what, _, _ in failed]}
    text = json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False)
    (context.output / "validation.json").write_text(text + "\n", encoding="utf-8")
    falls, walks = sum(row["falls"] for row in rows), sum(row["walks"] for row in rows)
    return {
        "headline": f"{len(checks) - len(failed)} of {len(checks)} checks passed, {falls} of {walks} walks fell",
        "gate": {"passed": not failed, "failures": [failure(*check) for check in failed]},
        "checks": [{"check": what, "value": value, "limit": limit} for what, value, limit in checks],
        "latency": timing,
        **report,
    }


def walk_limits(scenario: Scenario, p: Params) -> dict[str, float]:
    """Measure → its largest value: falls, drift, and how well the ordered speed is kept."""
    limits: dict[str, float] = {"falls": p.walk_falls, "drift": scenario.drift_slack * p.walk_drift}
    if scenario.vx or scenario.vy:
        limits["speed_error"] = scenario.speed_slack * p.walk_speed_error
    if scenario.wz:
        limits["yaw_error"] = p.walk_yaw_error
    return limits


def walk_checks(row: Mapping[str, Any]) -> list[Check]:
    """One check per limit of a row of `run_scenarios`, of its worst walk."""
    found = {"falls": row["falls"], **row["worst"]}
    where = f"{row['scenario']} ({row['title']}, {row['walks']} walks)"
    return [(f"{where}: {_WORDS[name]}", found[name], limit) for name, limit in row["limits"].items()]


def missed(checks: Sequence[Check]) -> list[Check]:
    """The checks above their limit, without a value, or NaN."""
    return [(what, value, limit) for what, value, limit in checks if value is None or not value <= limit]


def failure(what: str, value: float | None, limit: float) -> str:
    """One line for a missed check."""
    return f"{what}: {'none finished' if value is None else f'{value:.4g}'}, expected at most {limit:g}"


def _torque_error(context: Any) -> dict[str, float]:
    """Free-running error of the actuator model on held-out trials, beside persistence."""
    from hqpipe.identify.rivals.compare import PERSISTENCE, compare_models
    from hqpipe.stages.inputs.logs import foreign_fit, model_for, read_logs
    from hqpipe.stages.output.terminal import show

    log_set = read_logs(context)
    show(*(f"warning: {text}" for text in foreign_fit(context, log_set)))
    model = model_for(context, log_set.joints)
    rows = {row.model: row for row in reversed(compare_models(log_set, {"model": model}))}
    return {
        "rmse": rows["model"].free_run.rmse,
        "nrmse": rows["model"].free_run.nrmse,
        "persistence_rmse": rows[PERSISTENCE].free_run.rmse,
        "noise_floor": rows["model"].noise_floor,
    }


def _parity(context: Any) -> float:
    from hqpipe.rl.controller import read_wiring
    from hqpipe.rl.onnx_session import parity
    from hqpipe.rl.parity_file import read_parity

    folder = context.inputs["onnx"]
    observations, actions = read_parity(folder, len(read_wiring(folder).joints))
    return parity(folder / "policy.onnx", observations, actions)
