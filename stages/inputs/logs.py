"""The logs that a stage reads, and the actuator model that belongs to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from hqpipe.errors import ConfigError, UsageError

FIT = "fit.json"
STRESS = "stress"  # a log set inside the log set, which models are judged on and never fitted to
_STRESS_BRINGS = ("constant", "saturated")  # no reason for a warning there: commands that stand still, valves full open


def read_logs(context: Any, most: int | None = None, name: str = "logs") -> Any:
    """The `LogSet` of the input `name`, or sections of it with at most about `most` samples × joints; it tells its warnings.

    Its path is made relative to the project, or is the folder's bare name outside of it, so that what a stage writes does
    not depend on where the project lies.
    """
    from hqpipe.logs.log_set import read_log_set
    from hqpipe.stages.output.terminal import show

    told = "" if name == "logs" else f"{name}: "
    log_set = read_log_set(context.inputs[name], strict=context.params.strict, most=most)
    show(*(f"warning: {told}{text}" for text in log_set.warnings))
    kinds = log_set.kinds or _kinds(context, log_set)
    return replace(log_set, path=shown_path(context, log_set.path), kinds=kinds)


def _kinds(context: Any, log_set: Any) -> dict[str, str]:
    """Joint → revolute or prismatic, by a URDF that lies in the log set, or by that of the project's robot if its joints are
    those of the logs."""
    from hqpipe.logs.joint_kinds import from_urdf
    from hqpipe.robots import load_robot
    from hqpipe.urdf import read_urdf

    described = Path(log_set.robot or "")
    inside = described.suffix == ".urdf" and not described.is_absolute() and ".." not in described.parts
    if inside and (log_set.path / described).is_file():
        urdf = log_set.path / described
    else:
        robot = load_robot(context.robot)
        if not set(log_set.joints) <= set(robot.joints):
            return {}
        urdf = robot.urdf
    return from_urdf({name: joint.kind for name, joint in read_urdf(urdf).joints.items()}, log_set.joints)


def stated_travel(context: Any, log_set: Any) -> dict[str, tuple[float, float]]:
    """Joint → lowest and highest position, where robot.yaml is of these joints; empty elsewhere."""
    from hqpipe.robots import load_robot

    robot = load_robot(context.robot)
    if not set(log_set.joints) <= set(robot.joints):
        return {}
    pairs = zip(robot.position_lower.tolist(), robot.position_upper.tolist(), strict=True)
    return {joint: pair for joint, pair in zip(robot.joints, pairs, strict=True) if joint in log_set.joints}


def shown_path(context: Any, path: Path) -> Path:
    """A folder relative to the project, or its bare name outside of it."""
    project = context.output.resolve().parents[2]  # <project>/artifacts/store/<output>
    path = path.resolve()
    return path.relative_to(project) if path.is_relative_to(project) else Path(path.name)


def read_stress(context: Any, log_set: Any) -> Any:
    """The `LogSet` in the folder `stress` of the input `logs`, all of it held out; None where there is no such folder.

    Args:
        log_set: the one that it lies in, whose order of joints it takes.

    Raises:
        LogError: it cannot be used, or repeats a fit trial.
    """
    from hqpipe.logs.log_set import read_log_set
    from hqpipe.logs.overlap import check_apart, fingerprint
    from hqpipe.stages.output.terminal import show

    folder = context.inputs["logs"] / STRESS
    if not folder.is_dir():
        return None
    found = read_log_set(folder, strict=context.params.strict, all_heldout=True)
    show(*(f"warning: {STRESS}: {text}" for text in found.warnings if not text.startswith(_STRESS_BRINGS)))
    fit = [fingerprint(trial.table(folder.parent)) for trial in log_set.fit]
    judged = [fingerprint(trial.table(folder)) for trial in found.trials]
    show(*(f"warning: {STRESS}: {text}" for text in check_apart(fit, judged)))
    trials = tuple(replace(trial, trajectory=trial.trajectory.for_joints(log_set.joints)) for trial in found.trials)
    return replace(found, joints=log_set.joints, trials=trials, path=Path(STRESS))


def model_for(context: Any, joints: tuple[str, ...]) -> Any:
    """The actuator model of the input `actuator`, with its rows in the order of `joints`.

    Raises:
        UsageError: it was fitted to another machine.
    """
    return model_at(context.inputs["actuator"], joints)


def model_at(folder: Path, joints: tuple[str, ...], option: str = "--actuator") -> Any:
    """The actuator model in `folder`, with its rows in the order of `joints`; `option` names another folder.

    Raises:
        UsageError: it was fitted to another machine.
    """
    from hqpipe.actuators.files import load_actuator

    model = load_actuator(folder)
    if missing := [joint for joint in joints if joint not in model.joints]:
        raise UsageError(
            f"the actuator model was fitted to joints {', '.join(model.joints)} and has no '{missing[0]}'",
            file=folder,
            field=missing[0],
            fix=f"run hqpipe fit-actuator on logs of this machine first, or name another model with {option} DIR",
        )
    return model.for_joints(joints)


def foreign_fit(context: Any, log_set: Any) -> list[str]:
    """A warning if the actuator model was fitted to other logs than `log_set`; a model without fit.json says nothing."""
    from hqpipe.files.documents import read_json
    from hqpipe.files.entries import Entry

    path = context.inputs["actuator"] / FIT
    if not path.is_file():
        return []
    fix = "give the folder of hqpipe fit-actuator, or run it again"
    logs = Entry(read_json(path, fix), path, fix).table().get("logs")
    if logs is None:
        raise ConfigError(f"{path}: missing field 'logs'", file=path, field="logs", fix=fix)
    fitted = {name: entry.text() for name, entry in logs.table().items() if name in ("sha256", "path")}
    if missing := [name for name in ("sha256", "path") if name not in fitted]:
        raise logs.error(f"missing field '{missing[0]}'")
    if fitted["sha256"] == log_set.sha256:
        return []
    return [
        f"the actuator model was fitted to other logs ({fitted['path']}) than these ({log_set.path}): if that is not meant, "
        "run hqpipe fit-actuator on these first"
    ]
