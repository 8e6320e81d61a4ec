"""`hqpipe diagnose --reference DIR` as a user types it: one answer, and what is refused."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from hqpipe.actuators.files import save_actuator
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.cli import run_cli
from hqpipe.logs.writer import LogSetWriter
from hqpipe.machine import EFFECTS
from hqpipe.stages import STAGES

sys.path.insert(0, str(Path(__file__).parents[1] / "recovery"))
import planted_effects as planted

ROOT = Path(__file__).parents[2]
JOINTS = ("LFR", "LFP")
SMALL = f"without=[{', '.join(name for name in EFFECTS if name not in ('valve_lag', 'valve_deadband'))}]"


def write(
    folder: Path, seed: int, joints: tuple[str, ...] = JOINTS, every: int = 1, slower: float = 1.0, **kwargs
) -> Path:
    """Logs of one row of so many, on a clock that goes slower."""
    logs = planted.logs_of([{}] * len(joints), seconds=6.0, seed=seed, joints=joints, **kwargs)
    with LogSetWriter(
        folder, control_mode="position", effort_source="load_cell", rate_hz=1000.0 / every / slower
    ) as writer:
        for trial in logs.trials:
            t = trial.trajectory
            columns = {"time": slower * t.time[::every]}
            for j, joint in enumerate(joints):
                for name in ("position", "velocity", "position_command", "effort"):
                    values = getattr(t, name)[::every, j]
                    columns[f"joint/{joint}/{name}"] = values / slower if name == "velocity" else values
            writer.add(trial.file, columns, split=trial.split)
    return folder


@pytest.fixture(scope="module")
def machine(tmp_path_factory) -> Path:
    """A project with logs of then and of now, in which the second joint leaks 1.8 times as much."""
    folder = tmp_path_factory.mktemp("machine")
    shutil.copy(ROOT / "pipeline.yaml", folder)
    write(folder / "then", 1)
    write(folder / "now", 2, gains=planted.leaking(1.0, 1.8))
    return folder


@pytest.fixture
def hqpipe(machine, monkeypatch, capfd):
    monkeypatch.chdir(machine)

    def call(*arguments: str) -> tuple[int, str, str]:
        capfd.readouterr()
        code = run_cli(STAGES, arguments)
        return code, *capfd.readouterr()

    return call


def test_what_changed_since_is_told_and_written(hqpipe, machine):
    code, _, told = hqpipe("diagnose", "--logs", "now", "--reference", "then", "--set", SMALL)
    assert code == 0, told
    assert "✓ changed since then" in told and "leakage change · LFP · ratio 1.8" in told
    content = json.loads((machine / "artifacts" / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["reference"] == {"path": "then", "kind": "logs", "sha256": content["reference"]["sha256"]}
    assert content["reference"]["sha256"] != content["logs"]["sha256"]
    page = (machine / "artifacts" / "diagnosis" / "diagnosis.html").read_text(encoding="utf-8")
    assert "Changed since then" in page and "--reference then" in page and "<h2>Causes</h2>" not in page
    manifest = json.loads((machine / "artifacts" / "diagnosis" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["sources"].keys() == {"logs", "reference"}


def pd(folder: Path) -> Path:
    save_actuator(StiffPD.build(JOINTS, kp=100.0, kd=1.0, effort_limit=np.inf), folder)
    return folder


def coefficients(folder: Path, joints: tuple[str, ...] = JOINTS, dt: float = 1e-3) -> Path:
    values = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36, "sprocket_radius": 1.0, "effort_limit": np.inf}
    save_actuator(Hydraulic.build(joints, dt=dt, **values), folder)
    return folder


@pytest.mark.parametrize(
    "make,message",
    [
        (lambda f: f / "absent", "no such folder"),
        (pd, "a model of kind 'stiff_pd' has no coefficients to compare: give artifacts/actuator"),
        (lambda f: coefficients(f, ("LFR", "RFP")), "joints LFR, LFP and LFR, RFP, without 'LFP'"),
        (lambda f: coefficients(f, dt=0.0014), "sample times 0.001 s and 0.0014 s"),
        (lambda f: write(f, 1, ("LFR", "LFQ")), "joints LFR, LFP and LFR, LFQ, without 'LFP'"),
        (lambda f: write(f, 1, slower=1.4), "sample times 0.001 s and 0.0014 s"),
    ],
)
def test_what_cannot_be_a_reference_is_refused_in_one_line(hqpipe, tmp_path, make, message):
    folder = make(tmp_path / "other")
    code, _, told = hqpipe("diagnose", "--logs", "now", "--reference", str(folder), "--set", SMALL)
    assert code == 2
    (line,) = [line for line in told.splitlines() if line.startswith("error:")]
    assert message in line


def test_a_slower_record_of_the_same_controller_is_a_reference(hqpipe, machine, tmp_path):
    reference = write(tmp_path / "slow", 1, every=5)
    code, _, told = hqpipe("diagnose", "--logs", "now", "--reference", str(reference), "--set", SMALL)
    assert code == 0, told
    content = json.loads((machine / "artifacts" / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    (cause,) = content["causes"]
    assert (cause["effect"], cause["joints"]) == ("leakage_change", ["LFP"])
    assert cause["parameters"]["ratio"]["value"] == pytest.approx(1.8, rel=0.1)


def test_a_folder_of_something_else_is_told_apart(hqpipe, tmp_path):
    (tmp_path / "weights.npz").write_bytes(b"0")
    code, _, told = hqpipe("diagnose", "--logs", "now", "--reference", str(tmp_path), "--set", SMALL)
    assert code == 1 and "--reference holds no actuator.json, so it was read as logs" in told


def test_help_names_the_option(hqpipe):
    assert "--reference DIR" in hqpipe("diagnose", "--help")[1]
