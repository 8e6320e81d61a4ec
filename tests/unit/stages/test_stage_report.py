"""report, without a plant: what it films of a walk, and what it says of results that do not belong together."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError

from hqpipe.errors import UsageError
from hqpipe.robots import load_robot, robot_folder
from hqpipe.stages import STAGES
from hqpipe.stages.report import Params, _other_plants, _parts, _strangers, run
from hqpipe.stages.walks import machine

FOLDER = robot_folder("hydraulic_quadruped")
SMALL = {"seconds": 3.0, "shown_seconds": 0.5, "frame_rate": 10, "width": 240, "height": 120}


def trial(fall_time: float | None) -> SimpleNamespace:
    """Three seconds that glide ahead at 0.8 m/s."""
    robot, time = load_robot(FOLDER), np.arange(3000) * 1e-3
    zero, one = np.zeros(3000), np.ones(3000)
    columns = {"time": time, "supply/pressure": 2e7 * one, "command/vx": one}
    for i, joint in enumerate(robot.joints):
        angle = robot.nominal_position[i] + 1e-3 * np.sin(time)
        columns |= {f"joint/{joint}/{signal}": angle for signal in ("position", "position_command")}
        columns[f"joint/{joint}/effort"] = 100.0 * np.sin(time)
    columns |= {f"base/position/{a}": v for a, v in zip("xyz", (0.8 * time, zero, 0.877 * one), strict=True)}
    columns |= {f"base/orientation/{a}": v for a, v in zip("xyzw", (zero, zero, zero, one), strict=True)}
    columns |= {f"base/linear_velocity/{a}": v for a, v in zip("xyz", (0.8 * one, zero, zero), strict=True)}
    columns |= {f"foot/{foot}/contact": (time % 0.6 < 0.35).astype(float) for foot in robot.feet}
    return SimpleNamespace(columns=columns, time=time, fell=fall_time is not None, fall_time=fall_time)


def made(folder: Path, artifact: str, **recipe) -> Path:
    """A folder with a record, as far as the stage reads it."""
    folder = folder / "store" / artifact
    folder.mkdir(parents=True, exist_ok=True)
    recipe = {"stage": STAGES.maker(artifact).name, "version": 1, "params": {}, "seed": 1, "inputs": {}} | recipe
    record = {
        "key": "0" * 64,
        "recipe": recipe,
        "sources": {name: {"artifact": "any"} for name in recipe["inputs"]},
        "outputs": {"actuator.json": "a1", "posterior.json": "b2", "fit.png": "c3"},
        "metrics": {"headline": "made up", "bytes": 1000},
        "provenance": {
            "hqpipe": "0.1.0",
            "created": "2026-01-02T03:04:05+00:00",
            "python": "3.11.7",
            "packages": {},
            "git": None,
            "machine": {"cpu": "EPYC", "cores": 2, "system": "Linux"},
            "profile": "ci",
            "wall_time_s": 1.0,
        },
    }
    (folder / "manifest.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


def context(folder: Path, inputs: dict[str, Path], **params) -> SimpleNamespace:
    return SimpleNamespace(
        params=Params(**params),
        seed=1,
        workers=1,
        robot=FOLDER,
        inputs=inputs,
        output=folder,
        progress=lambda done, total, note: None,
    )


def reported(monkeypatch, folder: Path, fall_time: float | None = None, **params) -> tuple[dict, list]:
    """The metrics of a report in `folder`, and the jobs that the plant was given."""
    jobs: list = []
    monkeypatch.setattr(machine, "run_jobs", lambda given, *more: jobs.extend(given) or [trial(fall_time)])
    folder.mkdir()
    return run(context(folder, {"onnx": made(folder.parent, "onnx")}, **(SMALL | params))), jobs


def test_it_films_the_end_of_the_walk(monkeypatch, tmp_path):
    metrics, (job,) = reported(monkeypatch, tmp_path / "a", wz=0.2)
    assert (job.vx, job.wz, job.seconds, job.stop_at_fall) == (1.0, 0.2, 3.0, False)
    assert job.seed >= 1900, "collect and validate have the seeds below"
    with Image.open(tmp_path / "a" / "walk.gif") as film:
        assert film.n_frames == 5 and film.size == (240, 120) and film.info["duration"] == 100
    assert metrics["walk"]["shown"] == pytest.approx([2.499, 2.999])
    assert metrics["walk"]["speed"] == pytest.approx(0.8) and metrics["walk"]["fall_time"] is None
    assert metrics["missing"] == [
        "bootstrap",
        "rollouts",
        "actuator",
        "diagnosis",
        "policy",
        "validation",
        "comparison",
    ]
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"report.html", "walk.gif", "walk.png"}


def test_the_same_inputs_give_the_same_bytes(monkeypatch, tmp_path):
    for name in "ab":
        reported(monkeypatch, tmp_path / name)
    for name in ("report.html", "walk.gif", "walk.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_fall_is_shown_to_its_end(monkeypatch, tmp_path):
    metrics, _ = reported(monkeypatch, tmp_path / "a", fall_time=1.4)
    assert metrics["walk"]["shown"][1] == pytest.approx(2.4)
    assert metrics["headline"].startswith("0.80 m/s at 1, fell after 1.4 s")
    assert "The exported policy fell after 1.4 s" in (tmp_path / "a" / "report.html").read_text(encoding="utf-8")


def test_slow_motion_has_more_frames(monkeypatch, tmp_path):
    reported(monkeypatch, tmp_path / "a", speed=0.5)
    with Image.open(tmp_path / "a" / "walk.gif") as film:
        assert film.n_frames == 10


def test_a_film_that_would_not_fit_is_refused():
    with pytest.raises(ValidationError, match="would have 800 frames, expected at most 600"):
        Params(seconds=60.0, shown_seconds=40.0)
    assert Params(seconds=10.0, shown_seconds=40.0).seconds == 10.0, "no more is shown than there is"


def test_results_that_do_not_belong_together_are_told(tmp_path):
    known = STAGES["retrain"].inputs[0].content({"actuator.json": "a1", "posterior.json": "b2", "fit.png": "other"})
    inputs = {"onnx": made(tmp_path, "onnx"), "actuator": made(tmp_path, "actuator")}
    inputs["policy"] = made(tmp_path, "policy", inputs={"actuator": known})
    assert _strangers(_parts(context(tmp_path, inputs), STAGES), STAGES) == [], "a figure is no part of the model"
    inputs["policy"] = made(tmp_path, "policy", inputs={"actuator": "f" * 64})
    told = _strangers(_parts(context(tmp_path, inputs), STAGES), STAGES)
    assert told == ["artifacts/policy was made from another actuator than the one on this page"]


def test_another_plant_is_told(tmp_path):
    plant = {"fluid": {"temperature": 60.0}}
    inputs = {"onnx": made(tmp_path, "onnx"), "rollouts": made(tmp_path, "rollouts", params={"plant": plant})}
    parts = _parts(context(tmp_path, inputs), STAGES)
    assert _other_plants(parts, plant) == []
    (told,) = _other_plants(parts, {})
    assert "another plant than artifacts/rollouts" in told and '{"fluid": {"temperature": 60.0}}' in told


def test_a_folder_of_another_stage_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"made by fit-actuator, expected hqpipe export"):
        _parts(context(tmp_path, {"onnx": made(tmp_path, "actuator")}), STAGES)
