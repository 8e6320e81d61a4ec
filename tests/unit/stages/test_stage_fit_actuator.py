"""fit-actuator on two joints that obey the paper's model: what it writes, with and without stress trials."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from hqpipe.actuators.files import load_actuator
from hqpipe.actuators.posterior_file import load_posterior
from hqpipe.logs.writer import LogSetWriter
from hqpipe.pipeline.hashing import hash_files, tree_hash
from hqpipe.robots import robot_folder
from hqpipe.stages.fit_actuator import Params, run

JOINTS = ("hip", "knee")
K1, K2, K3 = 400.0, 0.04, 8.0


def columns(samples: int, seed: int, size: float = 0.3) -> dict[str, np.ndarray]:
    """A trial whose torque follows eq. (7) with k4 = 0, plus noise of 1 N·m."""
    rng, time = np.random.default_rng(seed), np.arange(samples) * 1e-3
    found = {"time": time}
    for joint in JOINTS:
        rate, phase = rng.uniform(10.0, 30.0), rng.uniform(0.0, 6.0)
        position, velocity = size * np.sin(rate * time), size * rate * np.cos(rate * time)
        command = size * np.sin(rate * time + 0.3) + 0.05 * np.sin(70.0 * time + phase)
        torque = np.zeros(samples)
        for k in range(samples - 1):
            torque[k + 1] = K1 * (command[k] - position[k]) + (1.0 - K2) * torque[k] - K3 * velocity[k]
        signals = {"position": position, "velocity": velocity, "position_command": command}
        signals["effort"] = torque + rng.normal(size=samples)
        found |= {f"joint/{joint}/{name}": values for name, values in signals.items()}
    return found


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    with LogSetWriter(folder) as writer:
        writer.add("a.parquet", columns(3001, 1))
        writer.add("b.parquet", columns(1501, 2), split="heldout")
    with LogSetWriter(folder / "stress") as writer:
        writer.add("drop.parquet", columns(1001, 3, size=0.6), split="heldout")
    return folder


def fitted(logs: Path, project: Path, **params) -> tuple[Path, dict]:
    output = project / "artifacts" / "store" / "made"
    output.mkdir(parents=True)
    context = SimpleNamespace(
        params=Params(**{"rivals": [], **params}),
        inputs={"logs": logs},
        output=output,
        robot=robot_folder("hydraulic_quadruped"),
        seed=1,
        workers=1,
        progress=lambda done, total, note: None,
    )
    return output, run(context)


@pytest.fixture(scope="module")
def made(logs, tmp_path_factory) -> tuple[Path, dict]:
    return fitted(logs, tmp_path_factory.mktemp("project"), data_seconds=[1.0, 2.0, 60.0])


def test_every_claim_has_its_numbers_and_its_figure(made):
    output, metrics = made
    for name in ("comparison.png", "stress.png", "data_curve.png", "fit.png", "fit_joints.png", "constants.png"):
        assert (output / name).stat().st_size > 5000
    assert metrics["held_out_rmse"]["per joint, free-running"]["free_run"] < 3.0
    assert metrics["stress_rmse"]["per joint, free-running"]["free_run"] < 3.0
    assert metrics["stress_rmse"]["persistence"]["free_run"] > metrics["held_out_rmse"]["persistence"]["free_run"]
    json.dumps(metrics, allow_nan=False)


def test_every_model_that_has_a_posterior_has_it_beside_it(made):
    for folder in (made[0], made[0] / "per_joint", made[0] / "shared"):
        model = load_actuator(folder)
        posterior = load_posterior(folder, model)
        assert posterior.fields == ("k1", "k2", "k3", "k4")
        assert np.isfinite(posterior.draw(model, 3, np.random.default_rng(0))[..., :4]).all()
    text = (made[0] / "posterior.json").read_text(encoding="utf-8")
    assert text == (made[0] / "per_joint" / "posterior.json").read_text(encoding="utf-8")
    assert text != (made[0] / "shared" / "posterior.json").read_text(encoding="utf-8")


def test_csv_and_json_agree_with_the_metrics(made):
    output, metrics = made
    with (output / "comparison.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    expected = metrics["stress_rmse"]["mean torque"]["one_step"]
    wanted = {"logs": "stress", "trial": "all", "joint": "all", "model": "mean torque", "horizon": "one_step"}
    (row,) = [r for r in rows if wanted.items() <= r.items() and r["measure"] == "rmse"]
    assert float(row["value"]) == expected
    tree = json.loads((output / "comparison.json").read_text(encoding="utf-8"))
    assert tree["logs"]["stress"]["models"]["mean torque"]["all"]["one_step"]["rmse"] == expected


def test_constants_are_what_the_coefficients_mean(made):
    """Joints that the robot does not have: k1 and k3 in joint space, and nothing to expect."""
    with (made[0] / "constants.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["joint"] for row in rows} == set(JOINTS) and {row["model"] for row in rows} == {"paper's model"}
    assert {row["expected"] for row in rows} == {""} and "bulk modulus" not in {row["quantity"] for row in rows}
    truth = {"flow gain": K1 / K3, "loop stiffness": K1 / K2, "leakage": K2 / K3}
    for row in rows:
        if row["quantity"] in truth:
            known, (low, high) = truth[row["quantity"]], (float(row["low"]), float(row["high"]))
            assert float(row["value"]) == pytest.approx(known, rel=0.02)
            assert low < float(row["value"]) < high and high - low < 0.05 * known


def test_a_joint_that_does_not_move_has_no_constants(tmp_path):
    """Neither model may give what its fit started from; the joint that moves keeps its numbers."""
    still = tmp_path / "still"
    with LogSetWriter(still) as writer:
        for name, seed, split in (("a.parquet", 1, "fit"), ("b.parquet", 2, "heldout")):
            held = columns(2001, seed)
            for signal in ("position", "velocity", "position_command"):
                held[f"joint/knee/{signal}"][:] = 0.0
            writer.add(name, held, split=split)
    output, _ = fitted(still, tmp_path, rivals=["two_chamber"])
    with (output / "constants.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["joint"] for row in rows} == {"hip"}
    assert {row["model"] for row in rows} == {"paper's model", "two chambers"}
    assert all(float(row["low"]) >= 0.0 for row in rows if row["low"])


def test_curve_ends_with_all_the_data(made):
    output, metrics = made
    points = json.loads((output / "data_curve.json").read_text(encoding="utf-8"))["points"]
    mine = [p for p in points if p["model"] == "per joint, free-running"]
    assert [round(p["seconds"], 3) for p in mine] == [1.0, 2.0, 3.0]
    whole = metrics["held_out_rmse"]["per joint, free-running"]["free_run"]
    assert mine[-1]["free_run"] == pytest.approx(whole, rel=1e-9)


def test_times_are_told_and_are_in_no_file(made, logs, tmp_path):
    output, metrics = made
    assert metrics["fit_s"].keys() == {"per joint, free-running", "shared, free-running"}
    assert metrics["step_us"].keys() == {
        f"{s}, {k}" for s in ("per joint", "shared") for k in ("free-running", "one-step")
    }
    again, _ = fitted(logs, tmp_path, data_seconds=[1.0, 2.0, 60.0])
    assert hash_files(again) == hash_files(output)


def test_logs_without_stress_trials_do(logs, tmp_path):
    plain = tmp_path / "plain"
    shutil.copytree(logs, plain, ignore=shutil.ignore_patterns("stress"))
    output, metrics = fitted(plain, tmp_path)
    assert metrics["stress_rmse"] == {}
    assert (output / "comparison.png").is_file()
    assert not (output / "stress.png").exists() and not (output / "data_curve.json").exists()


def test_stress_trials_change_no_coefficient_and_count_in_the_hash(made, logs, tmp_path):
    plain = tmp_path / "plain"
    shutil.copytree(logs, plain, ignore=shutil.ignore_patterns("stress"))
    output, _ = fitted(plain, tmp_path)
    assert (output / "actuator.json").read_bytes() == (made[0] / "actuator.json").read_bytes()
    assert tree_hash(plain) != tree_hash(logs)


def test_rivals_stand_in_the_same_table(logs, tmp_path):
    """Two chambers and a net, each in a folder that can be loaded; the seed is that of the stage."""
    output, metrics = fitted(logs, tmp_path, rivals=["two_chamber", "strong_mlp"], strong_net_iterations=2)
    for name, title in (("two_chamber", "two chambers of oil"), ("strong_mlp", "MLP, every advantage")):
        assert np.isfinite(metrics["held_out_rmse"][title]["free_run"])
        assert {title} <= metrics["fit_s"].keys() & metrics["step_us"].keys() & metrics["stress_rmse"].keys()
        model = load_actuator(output / "rivals" / name)
        assert model.joints == JOINTS
        assert (load_posterior(output / "rivals" / name, model) is None) == (name == "strong_mlp")
    assert metrics["held_out_rmse"]["two chambers of oil"]["free_run"] < 10.0
    lines = (output / "constants.csv").read_text(encoding="utf-8").splitlines()
    assert [any(line.startswith(f"{joint},two chambers,flow gain,") for line in lines) for joint in JOINTS] == [
        True,
        True,
    ]


def test_the_model_with_diagnosed_effects_stands_in_the_table_and_can_be_stepped(tmp_path):
    """On the paper's own model there is nothing to find."""
    title, longer = "paper's model with diagnosed effects", tmp_path / "longer"
    with LogSetWriter(longer) as writer:
        writer.add("a.parquet", columns(7501, 1))
        writer.add("b.parquet", columns(1501, 2), split="heldout")
    output, metrics = fitted(longer, tmp_path, rivals=["diagnosed"])
    assert metrics["effects"] == {} and not [text for text in metrics["warnings"] if text.startswith(title)]
    plain = metrics["held_out_rmse"]["per joint, free-running"]["free_run"]
    assert metrics["held_out_rmse"][title]["free_run"] == pytest.approx(plain, rel=0.1)
    assert metrics["step_us"][title] > 0.0 and metrics["fit_s"][title] > 0.0
    saved = load_actuator(output / "rivals" / "diagnosed")
    assert saved.NAME == "augmented" and saved.effects == {} and saved.joints == JOINTS


def test_a_rival_that_the_logs_do_not_allow_is_told_and_left_out(logs, tmp_path):
    still = tmp_path / "still"
    with LogSetWriter(still) as writer:
        for name, seed, split in (("a.parquet", 1, "fit"), ("b.parquet", 2, "heldout")):
            writer.add(name, columns(400, seed), split=split)
    _, metrics = fitted(still, tmp_path, rivals=["strong_gru"], strong_net_iterations=2)
    assert "GRU, every advantage" not in metrics["held_out_rmse"]
    assert any(text.startswith("GRU, every advantage: not fitted: ") for text in metrics["warnings"])


@pytest.mark.parametrize("wrong", [{"rivals": ["lsmt"]}, {"net_iterations": 0}])
def test_wrong_rivals_are_refused(wrong):
    with pytest.raises(ValidationError):
        Params(**wrong)
