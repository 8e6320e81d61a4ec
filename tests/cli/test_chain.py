"""The whole pipeline as a user runs it, on the small budget."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hqpipe.actuators.files import load_actuator
from hqpipe.gap.answer.schema import read_diagnosis
from hqpipe.logs.log_set import read_log_set
from hqpipe.stages import STAGES

ROOT = Path(__file__).parents[2]
# One rival of each kind: the others are the same code, and tests of their own train them.
RIVALS = ("--set", "fit_actuator.rivals=[diagnosed,two_chamber,strong_mlp]")
CHAIN = ("run", "all", "--profile", "ci", *RIVALS, "--json")


def hqpipe(project: Path, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "hqpipe.cli", *arguments],
        cwd=project,
        capture_output=True,
        text=True,
        timeout=1800,
        env={**os.environ, "COLUMNS": "200"},
    )


def actions(result: subprocess.CompletedProcess) -> dict[str, str]:
    return {stage["stage"]: stage["action"] for stage in json.loads(result.stdout)["stages"]}


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    shutil.copy(ROOT / "pipeline.yaml", folder)
    return folder


@pytest.fixture(scope="module")
def first_run(project) -> dict:
    result = hqpipe(project, *CHAIN)
    assert result.returncode == 0, result.stderr
    assert set(actions(result).values()) == {"ran"}
    return {stage["stage"]: stage["metrics"] for stage in json.loads(result.stdout)["stages"]}


def test_every_stage_leaves_its_artifact(project, first_run):
    for stage in STAGES.between(None, None):
        assert (project / "artifacts" / stage.artifact / "manifest.json").is_file()
    assert hqpipe(project, "verify").returncode == 0


def test_model_beats_persistence_and_stiff_pd_on_held_out_trials(first_run):
    errors = first_run["fit-actuator"]["held_out_rmse"]
    model = errors["per joint, free-running"]["free_run"]
    assert model < 0.5 * errors["persistence"]["free_run"]
    assert model < errors["stiff PD (fitted gains)"]["free_run"]
    assert model > first_run["fit-actuator"]["noise_floor"]


def test_model_holds_where_it_was_never_fitted(project, first_run):
    stressed = first_run["fit-actuator"]["stress_rmse"]
    assert stressed["per joint, free-running"]["free_run"] < 0.5 * stressed["persistence"]["free_run"]
    assert stressed["per joint, free-running"]["free_run"] < stressed["stiff PD (fitted gains)"]["free_run"]
    assert first_run["collect"]["stress"]["fall"]["fell"] and first_run["collect"]["stress"]["collapse"]["fell"]
    outputs = json.loads((project / "artifacts/rollouts/manifest.json").read_text())["outputs"]
    assert {"stress/logset.yaml", "stress/drop.parquet", "distribution.png"} <= set(outputs)


def test_effects_found_in_the_fit_trials_hold_in_the_others(project, first_run):
    fitted = first_run["fit-actuator"]
    for errors in (fitted["held_out_rmse"], fitted["stress_rmse"]):
        known = errors["paper's model with diagnosed effects"]["free_run"]
        assert known < 0.5 * errors["per joint, free-running"]["free_run"]
    joints = set(load_actuator(project / "artifacts/actuator").joints)
    assert fitted["effects"] and all(set(where) <= joints for where in fitted["effects"].values())
    stepped = load_actuator(project / "artifacts/actuator/rivals/diagnosed")
    assert stepped.effects.keys() <= fitted["effects"].keys()


def test_walks_under_the_same_order_are_not_the_same(project, first_run):
    trials = {t.file: t.trajectory for t in read_log_set(project / "artifacts/rollouts").heldout}
    walks = [trials[f"walk_10_{letter}.parquet"].effort[2000:] for letter in "abcd"]
    for i, walk in enumerate(walks):
        for other in walks[:i]:
            assert np.sqrt(np.mean((walk - other) ** 2)) > 0.2 * walk.std(), "more than the noise of a sensor"
    assert all(not first_run["collect"]["walks"][f"walk_10_{letter}"]["fell"] for letter in "abcd")


def test_diagnosis_is_valid_and_complete(project, first_run):
    folder = project / "artifacts/diagnosis"
    content = read_diagnosis(folder / "diagnosis.json")
    assert content["gap"]["before"] > content["gap"]["noise_floor"]
    assert content["gap"]["after"] <= content["gap"]["before"]
    assert set(content["logs"]["joints"]) == set(json.loads((folder / "traces.json").read_text())["joints"])
    for name in ("diagnosis.html", "actuator.json", "residuals.csv"):
        assert (folder / name).stat().st_size > 0


def test_exported_policy_walks_on_the_plant(first_run):
    metrics = first_run["validate"]
    assert metrics["gate"] == {"passed": True, "failures": []}
    rows = {row["scenario"]: row for row in metrics["scenarios"]}
    assert rows.keys() == {"forward_10", "stand"} and not any(row["falls"] for row in rows.values())
    assert all(walk["distance"] > 0.5 * walk["seconds"] for walk in rows["forward_10"]["seeds"])
    assert all(walk["estimate_tilt"] < 0.2 for row in rows.values() for walk in row["seeds"]), "the graph tells its x̃_t"


def test_deployment_description_fits_the_robot(project, first_run):
    deploy = yaml.safe_load((project / "artifacts/onnx/deploy.yaml").read_text())
    assert len(deploy["actions"]["joints"]) == 12
    assert deploy["rates"] == {"policy_hz": 100, "joint_controller_hz": 1000}


def test_the_report_shows_the_whole_chain(project, first_run):
    small = ("seconds=3.0", "shown_seconds=0.5", "width=240", "height=150")
    result = hqpipe(
        project, "report", "--profile", "ci", *(word for text in small for word in ("--set", text)), "--json"
    )
    assert result.returncode == 0, result.stderr
    (stage,) = json.loads(result.stdout)["stages"]
    assert stage["metrics"]["missing"] == ["comparison"], "which runs by its own name"
    assert stage["metrics"]["warnings"] == []
    page = (project / "artifacts/report/report.html").read_text(encoding="utf-8")
    assert "data:image/gif;base64," in page and page.count('class="missing"') == 1 and "hqpipe compare" in page


def test_a_second_run_keeps_everything(project, first_run):
    assert set(actions(hqpipe(project, *CHAIN)).values()) == {"kept"}


def test_another_fit_reruns_nothing_before_it_and_nothing_that_reads_the_same_model(project, first_run):
    changed = ("--set", "fit_actuator.seed=3", "--set", "fit_actuator.rivals=[]")
    done = actions(hqpipe(project, "run", "all", "--until", "retrain", "--profile", "ci", *changed, "--json"))
    assert done["bootstrap"] == done["collect"] == "kept"
    assert done["fit-actuator"] == "ran"
    assert done["retrain"] == "kept", "of the actuator only the model counts, and that hangs on no seed"


def test_a_changed_byte_is_named(project, first_run):
    weights = project / "artifacts/policy/policy.safetensors"
    content = bytearray(weights.read_bytes())
    content[-1] ^= 1
    weights.write_bytes(bytes(content))
    try:
        for command in (("verify",), ("export",)):
            result = hqpipe(project, *command)
            assert result.returncode == 3
            assert "policy.safetensors" in result.stderr + result.stdout
    finally:
        content[-1] ^= 1
        weights.write_bytes(bytes(content))
