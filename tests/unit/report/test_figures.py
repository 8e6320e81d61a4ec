"""Figures: readable files, the same bytes every time, the right stretch of data."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from diagnosis_cases import explained, not_identifiable

from hqpipe.errors import UsageError
from hqpipe.logs.trajectory import Trajectory
from hqpipe.report.comparison_figures import comparison_bars, stress_chart
from hqpipe.report.constants_figures import constants_chart
from hqpipe.report.controller_figures import PANELS, learning_curves, plant_panels
from hqpipe.report.data_curve_figures import data_curve_chart
from hqpipe.report.data_figures import Cloud, data_distribution
from hqpipe.report.fit_figures import PredictedTrial, actuator_fit, typical_and_worst, worst_windows
from hqpipe.report.gap_figures import gap_steps
from hqpipe.report.training_figures import read_metrics, training_curves
from hqpipe.report.walk_figures import forward_speed, walk_summary

TIME = np.arange(3000) * 1e-3
JOINTS = ("LFR", "LFP", "LFK")
MEASURED = 100.0 * np.sin(2 * np.pi * TIME[:, None] * [1.0, 1.5, 2.0])
PREDICTED = 0.95 * MEASURED


def metrics_csv(folder: Path) -> Path:
    lines = ["time/total_timesteps,rollout/reward_mean,eval/speed"]
    lines += [f"{1000 * i},{0.01 * i},{0.1 * i if i % 3 == 0 else ''}" for i in range(1, 10)]
    (folder / "metrics.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "metrics.csv"


def walk() -> Trajectory:
    contact = (TIME % 0.5 < 0.3).astype(float)
    extra = {f"foot/{foot}/contact": contact for foot in ("LF", "RF")}
    extra |= {"base/linear_velocity/x": np.ones(3000), "command/vx": np.ones(3000)}
    extra |= {"supply/pressure": 2e7 - 1e6 * contact, "base/position/z": 0.9 - 0.2 * (TIME > 2.5)}
    extra |= {f"base/orientation/{axis}": np.full(3000, axis == "w") for axis in "xyzw"}
    return Trajectory(TIME, JOINTS, MEASURED, MEASURED, effort=MEASURED, extra=extra)


def score_rows() -> list[dict]:
    rows = []
    for logs, trials, factor in (("held-out", ("a.parquet", "b.parquet"), 1.0), ("stress", ("drop.parquet",), 3.0)):
        for model, size in (("mine", 10.0), ("wild", float("inf")), ("persistence", 50.0)):
            stats = {"rmse": factor * size, "loaded_mape": None if model == "wild" else size}
            head = {
                "logs": logs,
                "model": model,
                "joint": "all",
                "one_step": stats,
                "free_run": stats,
                "noise_floor": 1.0,
            }
            rows += [{**head, "trial": trial} for trial in ("all", *trials)]
    return rows


def clouds() -> dict[str, dict[str, Cloud]]:
    narrow, wide = Cloud(0.001 * MEASURED[:, 0], MEASURED[:, 0]), Cloud(0.002 * MEASURED[:, 1], -2.0 * MEASURED[:, 2])
    return {kind: {"walking": narrow, "stress": wide} for kind in ("hip roll", "knee")}


def constant_rows() -> list[dict]:
    """Of two models; one value without an interval, one without anything to expect."""
    numbers = [(2e4, 1.9e4, 2.1e4, 1.95e4), (1.5e4, None, None, 1.95e4), (1.6e4, 1.5e4, 1.7e4, None)]
    head = {"quantity": "hydraulic stiffness", "unit": "N·m/rad"}
    places = [("LFP", "mine"), ("LFP", "other"), ("LFK", "mine")]
    return [
        {"joint": joint, "model": model, **head, "value": value, "low": low, "high": high, "expected": expected}
        for (joint, model), (value, low, high, expected) in zip(places, numbers, strict=True)
    ]


def walk_cells() -> list[dict]:
    """Two controllers in two scenarios; one of them fell in every walk of the second."""
    cells = []
    for scenario in ("slow", "fast"):
        for controller in ("torque", "mine"):
            lost = (scenario, controller) == ("fast", "torque")
            values = {name: None if lost or name == "torque_rmse" else 0.1 for name in PANELS if name != "falls"}
            head = {"scenario": scenario, "controller": controller, "walks": 3, "falls": 3 if lost else 0}
            cells += [{**head, **values, "actor": actor} for actor in ("policy", "zero_action")]
    return cells


def two_seeds(folder: Path) -> list[Path]:
    """Metrics of two trainings, of which the second stopped early."""
    rows = [f"{1000 * i},{0.01 * i},{0.5 / i if i % 2 else ''}" for i in range(1, 10)]
    files = [folder / "seed_1.csv", folder / "seed_2.csv"]
    for file, kept in zip(files, (9, 4), strict=True):
        text = "\n".join(["time/total_timesteps,rollout/reward_mean,eval/velocity_error", *rows[:kept]])
        file.write_text(text + "\n", encoding="utf-8")
    return files


CONTROLLERS = {"torque": "ideal torque", "mine": "mine"}
CURVES = {"mine": [(1.0, 50.0), (10.0, 20.0)], "net": [(1.0, None), (10.0, 30.0)]}
FITTED = PredictedTrial(TIME, MEASURED, MEASURED, PREDICTED, JOINTS)
DRAWINGS = {
    "bars": lambda path: comparison_bars(score_rows(), ["persistence"], path),
    "stress": lambda path: stress_chart(score_rows(), path),
    "distribution": lambda path: data_distribution(clouds(), path),
    "constants": lambda path: constants_chart(constant_rows(), path),
    "curve": lambda path: data_curve_chart(CURVES, 60.0, 1.0, path),
    "fit": lambda path: actuator_fit(FITTED, path),
    "joints": lambda path: worst_windows(FITTED, path),
    "training": lambda path: training_curves({"run": metrics_csv(path.parent)}, path),
    "learning": lambda path: learning_curves({"gone": [], "mine": two_seeds(path.parent)}, path),
    "plant": lambda path: plant_panels(walk_cells(), CONTROLLERS, path),
    "walk": lambda path: walk_summary(walk(), path, effort_limit=np.full(3, 150.0)),
    "fall": lambda path: walk_summary(walk(), path, posture=True, filmed=(1.0, 3.0), fall_time=2.5),
    "gap": lambda path: gap_steps(explained(), path),
}


@pytest.mark.parametrize("name", DRAWINGS)
@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_same_data_gives_the_same_bytes(name, suffix, tmp_path):
    first = DRAWINGS[name](tmp_path / f"a{suffix}").read_bytes()
    matplotlib.rcParams["font.size"] = 20.0  # a user's settings must not leak in
    try:
        second = DRAWINGS[name](tmp_path / f"b{suffix}").read_bytes()
    finally:
        matplotlib.rcdefaults()
    assert first == second and len(first) > 5000
    assert b"matplotlib" not in first[:400].lower()


def test_drawing_leaves_pyplot_and_the_users_style_alone(tmp_path):
    before = dict(matplotlib.rcParams)
    DRAWINGS["fit"](tmp_path / "a.png")
    assert dict(matplotlib.rcParams) == before
    code = "import hqpipe.report.fit_figures, sys; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_typical_and_worst_windows():
    residual = np.concatenate([[0.0], np.repeat([1.0, 9.0, 2.0, 3.0, 4.0], 100)])
    assert typical_and_worst(residual, 100) == {"median": 3, "worst": 1}


def test_forward_speed_follows_the_heading():
    half = np.sqrt(0.5)  # a quarter turn to the left: forward is the world's y
    turned = {f"base/orientation/{a}": np.full(3000, v) for a, v in zip("xyzw", (0, 0, half, half), strict=True)}
    extra = walk().extra | turned | {"base/linear_velocity/y": np.full(3000, 0.7)}
    assert forward_speed(Trajectory(TIME, JOINTS, MEASURED, MEASURED, extra=extra)) == pytest.approx(0.7)


def test_share_against_the_command_counts_loaded_samples_only():
    cloud = Cloud(np.array([0.1, -0.1, 0.1, 0.1]), np.array([100.0, 100.0, -60.0, -1.0]))
    assert cloud.against == pytest.approx(2 / 3)
    assert Cloud(np.ones(3), np.ones(3)).against == 0.0


def test_nothing_to_draw_is_said(tmp_path):
    with pytest.raises(UsageError, match="no row over all held-out trials"):
        comparison_bars([], [], tmp_path / "a.png")
    with pytest.raises(UsageError, match="no row of stress trials"):
        stress_chart([row for row in score_rows() if row["logs"] == "held-out"], tmp_path / "a.png")
    with pytest.raises(UsageError, match="no model could be fitted"):
        data_curve_chart({"net": [(1.0, None)]}, 60.0, 1.0, tmp_path / "a.png")
    with pytest.raises(UsageError, match="the diagnosis has no gap"):
        gap_steps(not_identifiable(), tmp_path / "a.png")
    with pytest.raises(UsageError, match="nothing to draw"):
        walk_summary(Trajectory(TIME, JOINTS, MEASURED, MEASURED), tmp_path / "a.png")
    with pytest.raises(UsageError, match="no training has a metrics table"):
        learning_curves({"gone": []}, tmp_path / "a.png")
    with pytest.raises(UsageError, match="no controller walked"):
        plant_panels([], CONTROLLERS, tmp_path / "a.png")
    (tmp_path / "m.csv").write_text("step,loss\n1,2\n", encoding="utf-8")
    with pytest.raises(UsageError, match="time/total_timesteps"):
        read_metrics(tmp_path / "m.csv")


@pytest.mark.parametrize("name", ["$\\frac$", "$$", "a_b^c", "<b>x", "[red]", "100 %"])
def test_names_of_joints_are_drawn_as_they_are(tmp_path, name):
    trial = PredictedTrial(TIME, MEASURED, MEASURED, PREDICTED, (name, "LFP", "LFK"))
    rows = [row | {"joint": name} for row in constant_rows()]
    assert actuator_fit(trial, tmp_path / "fit.png").stat().st_size > 1000
    assert worst_windows(trial, tmp_path / "joints.png").stat().st_size > 1000
    assert constants_chart(rows, tmp_path / "constants.png").stat().st_size > 1000
