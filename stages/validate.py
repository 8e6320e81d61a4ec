"""validate: the gate before a policy goes on the machine."""

from __future__ import annotations

import json
from typing import Any

from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from hqpipe.pipeline.config import StageParams


class Params(StageParams):
    """Thresholds, and the walk of the exported policy on the plant.

    Attributes:
        torque_nrmse: largest free-running torque error on held-out trials, over the torque's standard deviation.
        parity_rad: largest difference between ONNX Runtime and torch, rad.
        latency_us: largest median time of one call, µs; the policy has 10 ms.
        walk_speed: m/s. walk_seconds: s. walk_seeds: how many walks.
        walk_falls: how many of them may fall. walk_speed_error: largest mean error of those that do not, m/s.
        plant: as in collect. resample: as in fit-actuator.
    """

    torque_nrmse: PositiveFloat = 0.35
    parity_rad: PositiveFloat = 1e-4
    latency_us: PositiveFloat = 1000.0
    walk_speed: PositiveFloat = 1.0
    walk_seconds: PositiveFloat = 30.0
    walk_seeds: PositiveInt = 8
    walk_falls: NonNegativeInt = 0
    walk_speed_error: PositiveFloat = 0.05
    plant: dict[str, Any] = {}
    resample: bool = False


def run(context: Any) -> dict[str, Any]:
    from hqpipe.rl.onnx_session import latency
    from hqpipe.stages.figures import draw_walk
    from hqpipe.stages.machine import walked

    p = context.params
    torque = _torque_error(context)
    trials = _walk(context)
    walks = [walked(trial, p.walk_speed) for trial in trials]
    draw_walk(context.output, "walk 1", trials[0].columns, context.robot)
    finished = [walk for walk in walks if not walk["fell"]]
    falls = len(walks) - len(finished)
    error = max((walk["speed_error"] for walk in finished), default=None)
    timing = latency(context.inputs["onnx"] / "policy.onnx")
    checks = [
        ("held-out torque error over its standard deviation", torque["nrmse"], p.torque_nrmse),
        ("difference to torch, rad", _parity(context), p.parity_rad),
        ("latency, µs", timing["median_us"], p.latency_us),
        (f"falls in {len(walks)} walks at {p.walk_speed:g} m/s on the plant", falls, p.walk_falls),
        ("speed error of the walks, m/s", error, p.walk_speed_error),
    ]
    failures = [
        f"{what}: {'none finished' if value is None else f'{value:.4g}'}, expected at most {limit:g}"
        for what, value, limit in checks
        if value is None or not value <= limit  # NaN is a failure
    ]
    failed = [what for what, value, limit in checks if value is None or not value <= limit]
    report = {"torque": torque, "walks": walks, "failed": failed}  # no timing, so that the bytes can be made again
    text = json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False)
    (context.output / "validation.json").write_text(text + "\n", encoding="utf-8")
    speed = sum(walk["speed"] for walk in finished) / len(finished) if finished else 0.0
    return {
        "headline": (
            f"{len(checks) - len(failures)} of {len(checks)} checks passed, {speed:.2f} m/s at {p.walk_speed:g}"
        ),
        "gate": {"passed": not failures, "failures": failures},
        "checks": [{"check": what, "value": value, "limit": limit} for what, value, limit in checks],
        "latency": timing,
        **report,
    }


def _torque_error(context: Any) -> dict[str, float]:
    """Free-running error of the actuator model on held-out trials, beside persistence."""
    from hqpipe.stages.logs import foreign_fit, model_for, read_logs
    from hqpipe.stages.terminal import show
    from hqpipe.sysid.compare import PERSISTENCE, compare_models

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
    import numpy as np

    from hqpipe.rl.onnx_session import parity
    from hqpipe.stages.export import REFERENCE

    folder = context.inputs["onnx"]
    with np.load(folder / REFERENCE, allow_pickle=False) as reference:
        return parity(folder / "policy.onnx", reference["observations"], reference["actions"])


def _walk(context: Any) -> list[Any]:
    """Trials of the exported policy on the plant."""
    from hqpipe.stages.machine import Job, run_jobs

    p = context.params
    # Seeds apart from those of collect, so that no walk repeats one that was logged.
    jobs = [
        Job(f"walk {i + 1}", p.walk_seconds, 1000 * context.seed + 500 + i, vx=p.walk_speed)
        for i in range(p.walk_seeds)
    ]
    return run_jobs(jobs, context.robot, context.inputs["onnx"], p.plant, context.workers, context.progress)
