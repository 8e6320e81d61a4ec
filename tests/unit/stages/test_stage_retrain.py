"""retrain with a fitted model: what it draws of the actuators, and what it says of it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior
from hqpipe.actuators.posterior_file import FILE, save_posterior
from hqpipe.errors import ConfigError
from hqpipe.machine.layout import FIELDS as layout
from hqpipe.machine.layout import neutral_row
from hqpipe.robots import load_robot, robot_folder
from hqpipe.stages.inputs.training import RANDOMISATION
from hqpipe.stages.retrain import Params, actuators_told, run

FIELDS = ("k1", "k2", "k3", "k4")
K = np.array([1.0e5, 0.06, 3.8e3, 20.0])
TRAINING = {
    "total_steps": 40,
    "num_envs": 4,
    "engine": "mujoco",
    "episode_s": 0.2,
    "policy": {"hidden": [8]},
    "ppo": {"n_steps": 10, "batch_size": 20, "n_epochs": 1, "critic_warmup": 1},
    "evaluation": {"num_envs": 2, "seconds": 0.1, "interval": 1, "commands": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]},
}


@pytest.fixture
def fitted(tmp_path) -> Path:
    """The folder of a model of the robot's joints with a posterior of 5 %."""
    robot = load_robot("hydraulic_quadruped")
    columns = dict(zip(FIELDS, K, strict=True))
    model = Hydraulic.build(robot.joints, dt=1e-3, sprocket_radius=0.06, effort_limit=1000.0, **columns)
    spread, upper = np.diag((0.05 * K) ** 2), np.array([np.inf, 1.0, np.inf, np.inf])
    groups = tuple(Group((joint,), K, spread, None, 1, np.zeros(4), upper) for joint in robot.joints)
    save_actuator(model, tmp_path / "actuator")
    save_posterior(Posterior("hydraulic", FIELDS, groups), model, tmp_path / "actuator")
    return tmp_path / "actuator"


def retrained(folder: Path, output: Path, **actuator) -> dict:
    output.mkdir()
    training = TRAINING | ({"randomisation": {"actuator": actuator}} if actuator else {})
    context = SimpleNamespace(
        params=Params(training=training),
        inputs={"actuator": folder},
        output=output,
        scratch=output / "scratch",
        robot=robot_folder("hydraulic_quadruped"),
        seed=1,
        workers=1,
        progress=lambda done, total, note: None,
    )
    return run(context)


def test_the_posterior_beside_the_model_is_drawn_from_and_reported(fitted, tmp_path, capsys):
    metrics = retrained(fitted, tmp_path / "policy", scale=1.5)
    report = json.loads((tmp_path / "policy" / RANDOMISATION).read_text(encoding="utf-8"))
    assert report["mode"] == "posterior" and report["scale"] == 1.5 and report["robots"] == 4
    for joint in report["joints"].values():
        assert joint["k1"]["low"] < joint["k1"]["high"] and joint["k1"]["model"] == K[0]
    assert metrics["actuator_randomisation"]["mode"] == "posterior"
    said = " ".join(capsys.readouterr().err.split())
    assert "drawn from the posterior of the fit, 1.5 times its deviations" in said
    assert "the draws hold the error of the estimate only" in said


def test_the_model_of_a_diagnosis_is_drawn_with_its_alternatives(tmp_path, capsys):
    """A deadband or the lag of a valve in the first joint."""
    joints = load_robot("hydraulic_quadruped").joints
    names = ("k1", "valve_deadband_half_width", "valve_lag_time_constant_s")
    rows = np.tile(neutral_row(), (len(joints), 1))
    rows[:, [layout.index(("base", name)) for name in ("k1", "k2", "k3")]] = 540.0, 0.05, 21.6
    rows[0, layout.index(("valve_deadband", "half_width"))] = 0.01

    def group(joint, *sizes):
        scatter = np.diag(np.array([10.0, 0.0, 0.0]) ** 2)
        return Group((joint,), np.array([540.0, *sizes]), scatter, None, 2, np.zeros(3), np.full(3, 1e3))

    laws = (
        Alternative("as diagnosed", 0.5, (group(joints[0], 0.01, 0.0),)),
        Alternative("valve_lag in place of valve_deadband", 0.5, (group(joints[0], 0.0, 0.005),)),
    )
    model = Augmented(joints, rows, 1e-3)
    others = tuple(group(joint, 0.0, 0.0) for joint in joints[1:])
    save_actuator(model, tmp_path / "diagnosis")
    save_posterior(Posterior("augmented", names, others, (Choice(laws),)), model, tmp_path / "diagnosis")
    metrics = retrained(tmp_path / "diagnosis", tmp_path / "policy")
    report = json.loads((tmp_path / "policy" / RANDOMISATION).read_text(encoding="utf-8"))
    (choice,) = report["alternatives"]
    assert choice["joints"] == [joints[0]] and sum(each["robots"] for each in choice["drawn"]) == 4
    assert metrics["actuator_randomisation"]["alternatives"] == report["alternatives"]
    said = " ".join(capsys.readouterr().err.split())
    counts = [each["robots"] for each in choice["drawn"]]
    assert f"as diagnosed in {counts[0]}, valve_lag in place of valve_deadband in {counts[1]} of 4 robots" in said
    assert "hold the error of the estimate only" not in said
    half = retrained(tmp_path / "diagnosis", tmp_path / "half", mode="half_range")["actuator_randomisation"]
    assert half == {"mode": "half_range", "robots": 4, "half_range": 0.2}


def test_without_posterior_the_half_range_is_used_and_named(fitted, tmp_path):
    (fitted / FILE).unlink()
    report = retrained(fitted, tmp_path / "policy")["actuator_randomisation"]
    assert report == {"mode": "half_range", "robots": 4, "half_range": 0.2}
    assert actuators_told(report) == ["actuators: each coefficient within ±20 % of the model's"]
    with pytest.raises(ConfigError, match="mode is posterior, but the actuator model has no posterior.json"):
        retrained(fitted, tmp_path / "other", mode="posterior")


def test_a_posterior_of_another_fit_is_refused(fitted, tmp_path):
    path = fitted / "actuator.json"
    path.write_text(path.read_text(encoding="utf-8").replace("100000.0", "100001.0"), encoding="utf-8")
    with pytest.raises(ConfigError, match="they are of two fits"):
        retrained(fitted, tmp_path / "policy")
