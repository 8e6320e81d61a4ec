"""fit-actuator: k1 … k4 from logs, per joint and shared, beside what any model must beat."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from pydantic import PositiveFloat

from hqpipe.errors import UsageError, near_match
from hqpipe.pipeline.config import StageParams
from hqpipe.stages.logs import FIT, read_logs

FOREIGN = "the joints are not those of the robot: R is 1, k1 in N·m/rad, and no effort limit holds"


class Params(StageParams):
    """Attributes:
    scope: which fit the later stages use; both are made. window_s: length of the free-running windows, s.
    resample: interpolate trials whose clock jitters onto a uniform one.
    """

    scope: Literal["per_joint", "shared"] = "per_joint"
    window_s: PositiveFloat = 0.1
    resample: bool = False


def run(context: Any) -> dict[str, Any]:
    from hqpipe.actuators.files import save_actuator
    from hqpipe.report.tables import coefficient_table, comparison_table
    from hqpipe.stages.figures import draw_fit
    from hqpipe.stages.terminal import show
    from hqpipe.sysid.compare import compare_models
    from hqpipe.sysid.fit_actuator import fit_actuator

    log_set = read_logs(context)
    constants = joint_constants(context.robot, log_set.joints)
    options = {"window_s": context.params.window_s, **constants}
    fits = {}
    for index, scope in enumerate(("per_joint", "shared")):
        context.progress(index, 3, scope.replace("_", " "))
        fits[scope] = fit_actuator(log_set, scope=scope, **options)
        save_actuator(fits[scope].model, context.output / scope)
    chosen = fits[context.params.scope]
    save_actuator(chosen.model, context.output)
    context.progress(2, 3, "held-out trials")
    models = {
        "per joint, free-running": fits["per_joint"].model,
        "per joint, one-step": fits["per_joint"].one_step_model,
        "shared, free-running": fits["shared"].model,
        "shared, one-step": fits["shared"].one_step_model,
    }
    rows = compare_models(log_set, models, window_s=context.params.window_s)
    show(coefficient_table(chosen.to_dict()), comparison_table([asdict(row) for row in rows]))
    notes = [*([] if constants else [FOREIGN]), *chosen.warnings]
    show(*(f"warning: {text}" for text in notes))
    _write(context.output, log_set, fits, rows)
    draw_fit(context.output, log_set, chosen.model, context.params.window_s)
    return {**_metrics(rows, chosen), "warnings": [*log_set.warnings, *notes]}


def joint_constants(robot_folder: Path, joints: tuple[str, ...]) -> dict[str, Any]:
    """Sprocket radius and effort limit of the robot's joints; nothing for the joints of another machine.

    Raises:
        UsageError: only some of the joints are the robot's.
    """
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    foreign = [joint for joint in joints if joint not in robot.joints]
    if len(foreign) == len(joints):
        return {}
    if foreign:
        raise UsageError(
            f"joint '{foreign[0]}' of the logs is not one of {robot.name}{near_match(foreign[0], robot.joints)}: rename it, "
            "or point `robot:` in pipeline.yaml to the machine that the logs are from"
        )
    return {
        "sprocket_radius": dict(zip(robot.joints, robot.sprocket_radius, strict=True)),
        "effort_limit": dict(zip(robot.joints, robot.effort_limit, strict=True)),
    }


def _write(output: Path, log_set: Any, fits: dict[str, Any], rows: list[Any]) -> None:
    from hqpipe.stages.training import write_rows

    report = {"logs": log_set.header(), **{scope: fit.to_dict() for scope, fit in fits.items()}}
    (output / FIT).write_text(json.dumps(report, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    flat = []
    for row in rows:
        record = asdict(row)
        for kind in ("one_step", "free_run"):
            record |= {f"{kind}/{name}": value for name, value in record.pop(kind).items()}
        flat.append(record)
    write_rows(output / "comparison.csv", flat)


def _metrics(rows: list[Any], fit: Any) -> dict[str, Any]:
    """Held-out errors of every model over all joints and trials, one step ahead and free-running."""
    from hqpipe.sysid.compare import ALL

    pooled = {row.model: row for row in rows if row.joint == row.trial == ALL}
    errors = {name: {"one_step": row.one_step.rmse, "free_run": row.free_run.rmse} for name, row in pooled.items()}
    model = pooled[f"{fit.scope.replace('_', ' ')}, free-running"]
    return {
        "headline": (
            f"held-out free run {model.free_run.rmse:.3g} N·m, persistence {errors['persistence']['free_run']:.3g}, "
            f"noise {model.noise_floor:.2g}"
        ),
        "held_out_rmse": errors,
        "noise_floor": model.noise_floor,
        "nrmse": model.free_run.nrmse,
    }
