"""What bootstrap, retrain and compare share: the training section of pipeline.yaml, and a trained policy's files."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

from hqpipe.errors import ConfigError
from hqpipe.pipeline.config import FieldError
from hqpipe.rl.config import TrainConfig, from_mapping, to_mapping

METRICS, EVALUATION, RANDOMISATION = "metrics.csv", "evaluation.json", "randomisation.json"


def _complete(raw: dict[str, Any]) -> dict[str, Any]:
    """Every field of TrainConfig, so that a changed default is a changed parameter."""
    if "seed" in raw:
        error = ConfigError("the seed of a training is the seed of its stage", field="seed", fix="set it one level up")
        raise FieldError(error)
    try:
        config = to_mapping(from_mapping(TrainConfig(), raw))
    except ConfigError as error:
        raise FieldError(error, getattr(error, "together", ())) from None
    del config["seed"]
    return config


Training = Annotated[dict[str, Any], AfterValidator(_complete)]
"""Nested fields of `hqpipe.rl.config.TrainConfig`, without the seed."""


def run_training(
    context: Any, actuator: Any, raw: dict[str, Any], control_mode: str, part: str = "", posterior: Any = None
) -> dict[str, Any]:
    """Train, write policy, metrics and what was drawn of the actuators into `output/part`, and return the metrics.

    Args:
        context: of the stage. actuator: model in the simulator. raw: a `Training`.
        control_mode: "position" or "torque". part: subfolder when a stage trains several policies.
        posterior: of the model's parameters, if it has one.
    """
    from hqpipe.rl.train import train
    from hqpipe.robots import load_robot

    result = train(
        load_robot(context.robot),
        actuator,
        from_mapping(TrainConfig(), {**raw, "seed": context.seed}),
        control_mode=control_mode,
        scratch=context.scratch / part,
        progress=lambda done, total, note: context.progress(done, total, f"{part} {note}".strip()),
        workers=context.workers,
        posterior=posterior,
    )
    return write_training(context.output / part, result)


def write_training(folder: Path, result: Any) -> dict[str, Any]:
    """Write a `TrainResult` into `folder`, as `run_training` does, and return its metrics."""
    from hqpipe.rl.policy_io import save_policy

    save_policy(folder, result.spec, result.networks)
    write_rows(folder / METRICS, result.rows)
    report = {
        "policy": result.best.to_dict(),
        "zero_action_baseline": result.baseline.to_dict(),
        "best_iteration": result.best_iteration,
    }
    (folder / EVALUATION).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    drawn = json.dumps(result.actuators, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / RANDOMISATION).write_text(drawn + "\n", encoding="utf-8")
    used = {key: value for key, value in result.actuators.items() if key != "joints"}
    return {
        **report,
        "actuator_randomisation": used,
        "steps_per_second": result.steps_per_second,
        "resumed_from": result.resumed_from,
    }


def headline(metrics: dict[str, Any]) -> str:
    """The policy's speed at the first command beside that of the prior alone, e.g. for the summary table."""
    learned, baseline = metrics["policy"], metrics["zero_action_baseline"]
    wanted = learned["commands"][0]["command"][0]
    speeds = [run["commands"][0]["velocity"][0] for run in (learned, baseline)]
    return (
        f"{speeds[0]:.2f} m/s at {wanted:g} (zero action {speeds[1]:.2f}), "
        f"{learned['falls']} of {learned['robots']} fell when pushed (zero action {baseline['falls']})"
    )


def write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write mappings as CSV; columns in order of first appearance, absent values empty."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
