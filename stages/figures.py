"""The figures that stages put beside their results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def draw_training(folder: Path, runs: Mapping[str, Path]) -> None:
    """training.png: learning curves of name → metrics.csv."""
    from hqpipe.report.training_figures import training_curves

    training_curves(runs, folder / "training.png")


def draw_walk(folder: Path, name: str, columns: Mapping[str, Any], robot_folder: Path) -> None:
    """walk.png: one walk of the plant, given as log columns."""
    import numpy as np

    from hqpipe.logs.assemble import assemble
    from hqpipe.logs.columns import RawTable
    from hqpipe.report.walk_figures import walk_summary
    from hqpipe.robots import load_robot

    robot = load_robot(robot_folder)
    trial = assemble(RawTable(Path(name), columns)).for_joints(robot.joints)
    walk_summary(trial, folder / "walk.png", effort_limit=np.asarray(robot.effort_limit))


def draw_fit(folder: Path, log_set: Any, model: Any, window_s: float) -> None:
    """fit.png: a typical and the worst window of the longest held-out trial, one step ahead and free-running."""
    from hqpipe.report.fit_figures import actuator_fit
    from hqpipe.stages.terminal import show
    from hqpipe.sysid.free_run import free_run, predict, window_samples

    trial = max((trial.trajectory for trial in log_set.heldout), key=lambda t: t.samples)
    if trial.samples <= window_samples(trial.dt, window_s):
        show("warning: no held-out trial lasts for a whole window, so there is no figure of the fit")
        return
    one_step, free = predict(trial, model, 1), free_run(trial, model, window_s)
    shown = trial.joints[:3]
    actuator_fit(
        trial.time,
        trial.effort,
        one_step,
        free,
        trial.joints,
        folder / "fit.png",
        window_s=window_s,
        shown=shown,
    )
