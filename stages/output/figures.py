"""The figures that stages put beside their results."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from hqpipe.stages.inputs.logs import STRESS

KIND_NAMES = {"R": "hip roll", "P": "hip pitch", "K": "knee"}  # of robot.yaml


def draw_training(folder: Path, runs: Mapping[str, Path]) -> None:
    """training.png: learning curves of name → metrics.csv."""
    from hqpipe.report.training_figures import training_curves

    training_curves(runs, folder / "training.png")


def walk_trajectory(name: str, columns: Mapping[str, Any], robot: Any) -> Any:
    """A walk of the plant, given as log columns, as a `Trajectory` in the joint order of `robot`, a `RobotSpec`."""
    from hqpipe.logs.assemble import assemble
    from hqpipe.logs.columns import RawTable

    return assemble(RawTable(Path(name), columns)).for_joints(robot.joints)


def draw_walk(folder: Path, name: str, columns: Mapping[str, Any], robot_folder: Path, **more: Any) -> None:
    """walk.png: one walk of the plant, given as log columns; `more` goes to `walk_summary`."""
    import numpy as np

    from hqpipe.report.walk_figures import walk_summary
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    trial = walk_trajectory(name, columns, robot)
    walk_summary(trial, folder / "walk.png", effort_limit=np.asarray(robot.effort_limit), **more)


def draw_distribution(folder: Path, logs: Mapping[str, list[Mapping[str, Any]]], robot: Any) -> None:
    """distribution.png: position error against torque by kind of joint.

    Args:
        logs: name → log columns of each trial. robot: a `RobotSpec`; its joints are called leg and kind, e.g. LFK.
    """
    import numpy as np

    from hqpipe.report.data_figures import Cloud, data_distribution

    kinds: dict[str, list[str]] = {}
    for joint in robot.joints:
        leg = next(foot for foot in robot.feet if joint.startswith(foot))
        kinds.setdefault(KIND_NAMES.get(joint.removeprefix(leg), joint.removeprefix(leg)), []).append(joint)

    def cloud(trials: list[Mapping[str, Any]], joints: list[str]) -> Cloud:
        pairs = [
            (t[f"joint/{j}/position_command"] - t[f"joint/{j}/position"], t[f"joint/{j}/effort"])
            for t in trials
            for j in joints
        ]
        error, torque = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        return Cloud(error, torque)

    panels = {kind: {name: cloud(trials, joints) for name, trials in logs.items()} for kind, joints in kinds.items()}
    data_distribution(panels, folder / "distribution.png")


def draw_comparison(folder: Path, rows: list[Mapping[str, Any]], models: Collection[str]) -> None:
    """comparison.png, and stress.png where there are stress trials.

    Args:
        rows: `ScoreRow` as mappings. models: names of those that are no baseline.
    """
    from hqpipe.report.comparison_figures import comparison_bars, stress_chart

    names = dict.fromkeys(row["model"] for row in rows)
    comparison_bars(rows, [name for name in names if name not in models], folder / "comparison.png")
    if any(row["logs"] == STRESS for row in rows):
        stress_chart(rows, folder / "stress.png")


def draw_data_curve(folder: Path, curve: Any) -> None:
    """data_curve.png: a `DataCurve`."""
    from hqpipe.report.data_curve_figures import data_curve_chart

    lines: dict[str, list[tuple[float, float | None]]] = {}
    for point in curve.points:
        lines.setdefault(point.model, []).append((point.seconds, point.free_run))
    data_curve_chart(lines, curve.persistence, curve.noise_floor, folder / "data_curve.png")


def draw_fit(folder: Path, log_set: Any, model: Any, window_s: float) -> None:
    """fit.png: a typical and the worst window of the longest held-out trial for three joints, one step ahead and
    free-running; fit_joints.png: the worst window of every joint."""
    from hqpipe.identify.free_run import free_run, predict, window_samples
    from hqpipe.report.fit_figures import PredictedTrial, actuator_fit, worst_windows
    from hqpipe.stages.output.terminal import show

    trial = max((trial.trajectory for trial in log_set.heldout), key=lambda t: t.samples)
    if trial.samples <= window_samples(trial.dt, window_s):
        show("warning: no held-out trial lasts for a whole window, so there is no figure of the fit")
        return
    one_step, free = predict(trial, model, 1), free_run(trial, model, window_s)
    predicted = PredictedTrial(trial.time, trial.effort, one_step, free, trial.joints, window_s)
    actuator_fit(predicted, folder / "fit.png")
    worst_windows(predicted, folder / "fit_joints.png")
