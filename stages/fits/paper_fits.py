"""The fits of the paper's model that fit-actuator makes: in both scopes, each fitted free-running and one step ahead."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from hqpipe.errors import UsageError, near_match

SCOPES = ("per_joint", "shared")
FREE_RUNNING, ONE_STEP = "{}, free-running", "{}, one-step"  # names of the models of a scope


def both_models(fit: Any) -> dict[str, Any]:
    """Name → model of a `FitResult`: fitted free-running, and one step ahead as in the paper."""
    scope = fit.scope.replace("_", " ")
    return {FREE_RUNNING.format(scope): fit.model, ONE_STEP.format(scope): fit.one_step_model}


def paper_fits(options: dict[str, Any]) -> dict[str, Callable[[Any], Any]]:
    """Name → fit of the paper's model, in the names of `both_models`; the two of a scope share their work."""
    from hqpipe.identify.paper_model.fit_actuator import fit_actuator

    @lru_cache(maxsize=len(SCOPES))
    def fitted(log_set: Any, scope: str) -> dict[str, Any]:
        return both_models(fit_actuator(log_set, scope=scope, **options))

    fits = {}
    for scope in SCOPES:
        for pattern in (FREE_RUNNING, ONE_STEP):
            name = pattern.format(scope.replace("_", " "))
            fits[name] = lambda log_set, scope=scope, name=name: fitted(log_set, scope)[name]
    return fits


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
