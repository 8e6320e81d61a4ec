"""The diagnosis as a whole: verdicts, place, file."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.errors import ConfigError, IdentificationError
from hqpipe.gap.diagnosis import FILE, NO_CANDIDATE, TABLE, diagnose, read_diagnosis, write_diagnosis
from hqpipe.gap.schema import validate_diagnosis
from hqpipe.sysid.fit_actuator import fit_actuator


def deadband(error, velocity, time):
    dead = np.sign(error) * np.maximum(np.abs(error) - 0.006, 0.0)
    return np.where(np.arange(len(error)) == 1, dead, error)


def without(logs, channel):
    trials = (replace(t, trajectory=replace(t.trajectory, **{channel: None})) for t in logs.trials)
    return replace(logs, trials=tuple(trials), control_mode=None)


@pytest.mark.parametrize("seed,noise,drive_noise", [(1, 2.0, 0.0), (2, 5.0, 0.0), (3, 1.0, 2.0), (4, 0.5, 0.5)])
def test_noise_alone_is_no_gap(make_logs, seed, noise, drive_noise):
    logs = make_logs(seed=seed, noise=noise, drive_noise=drive_noise)
    found = diagnose(logs, fit_actuator(logs).model)
    assert found.verdict == "no_gap"
    gap = found.content["gap"]
    assert gap["before"] == pytest.approx(gap["noise_floor"], rel=0.15)
    assert found.content["where"] == [] and not found.content["unexplained"]["above_noise"]


def test_planted_deadband_is_unknown_in_its_joint_and_by_its_signal(make_logs):
    logs = make_logs(joints=3, effect=deadband)
    found = diagnose(logs, fit_actuator(logs).model).content
    assert found["verdict"] == "unknown"
    assert found["where"][0]["joint"] == "LFP"
    assert all(place["joint"] == "LFP" for place in found["where"])
    assert found["unexplained"]["depends_on"][0]["signal"] == "position_error"
    assert found["unexplained"]["depends_on"][0]["joints"] == ["LFP"]
    gap = found["gap"]
    assert gap["after"] == gap["before"] > 2 * gap["noise_floor"]
    assert gap["shrink"] == 0.0 and gap["shrink_ci95"] == [0.0, 0.0]
    assert found["causes"] == [] and NO_CANDIDATE in found["warnings"]


def test_unlogged_disturbance_is_unknown_and_said_to_be_unpredictable(make_logs, right_model):
    logs = make_logs(joints=1)
    trial = logs.heldout[0]
    hum = 40.0 * np.sin(2 * np.pi * 7.3 * trial.trajectory.time)[:, None]
    loud = replace(trial, trajectory=replace(trial.trajectory, effort=trial.trajectory.effort + hum))
    found = diagnose(replace(logs, trials=(logs.trials[0], loud)), right_model(logs)).content
    assert found["verdict"] == "unknown" and found["unexplained"]["depends_on"] == []
    assert any("no logged signal predicts" in text for text in found["warnings"])


def test_half_a_second_is_not_identifiable(make_logs, right_model):
    logs = make_logs(seconds=0.5)
    found = diagnose(logs, right_model(logs)).content
    assert found["verdict"] == "not_identifiable" and found["gap"] is None
    assert any("complete windows" in text for text in found["warnings"])
    assert found["next_experiment"]


def test_no_motion_is_not_identifiable(make_logs, right_model):
    logs = make_logs(effect=lambda e, v, t: 0.0 * e)
    trials = []
    for trial in logs.trials:
        t = trial.trajectory
        trials.append(replace(trial, trajectory=replace(t, position_command=0.0 * t.position_command)))
    found = diagnose(replace(logs, trials=tuple(trials)), right_model(logs)).content
    assert found["verdict"] == "not_identifiable"
    assert any("no joint is commanded to move" in text for text in found["warnings"])


def test_without_held_out_trials_nothing_is_claimed(make_logs, right_model):
    logs = make_logs()
    lone = replace(logs, trials=(logs.trials[0],))
    found = diagnose(lone, right_model(logs)).content
    assert found["verdict"] == "not_identifiable"


def test_without_commands_only_sensing_is_evaluated(make_logs):
    found = diagnose(without(make_logs(), "position_command"), None).content
    assert found["verdict"] == "not_identifiable" and found["gap"] is None
    assert any("joint/<name>/position_command" in text for text in found["warnings"])


def test_without_effort_no_layer_is_left(make_logs, right_model):
    logs = make_logs(seconds=1.0)
    with pytest.raises(IdentificationError, match="joint/<name>/effort"):
        diagnose(without(logs, "effort"), right_model(logs))


def test_files_are_valid_and_reproducible(make_logs, right_model, tmp_path):
    logs = make_logs(seconds=4.0, effect=deadband)
    for name in ("one", "two"):
        write_diagnosis(diagnose(logs, right_model(logs)), tmp_path / name)
    for file in (FILE, TABLE):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    content = read_diagnosis(tmp_path / "one" / FILE)
    assert list(content) == (
        "format verdict logs gap where causes effects_considered unexplained next_experiment warnings".split()
    )
    with (tmp_path / "one" / TABLE).open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["trial"] for row in rows} == {"all", "b.parquet"}
    shares = [float(r["share"]) for r in rows if r["trial"] == "all" and r["family"] == "direction"]
    assert sum(shares) == pytest.approx(1.0, abs=1e-5)


def test_a_model_worse_than_persistence_is_said_so(make_logs):
    logs = make_logs(seconds=4.0)
    poor = Hydraulic.build(
        logs.joints, dt=1e-3, k1=5 * 537.0, k2=0.05, k3=0.0, k4=0.0, sprocket_radius=1.0, effort_limit=np.inf
    )
    found = diagnose(logs, poor).content
    assert any("worse than holding the torque" in text for text in found["warnings"])


@pytest.mark.parametrize(
    "change,message",
    [
        (lambda d: d.update(verdic="no_gap"), r"diagnosis\.verdic: unknown key.*did you mean 'verdict'"),
        (lambda d: d.pop("logs"), r"diagnosis\.logs: missing"),
        (lambda d: d["gap"].update(before="67"), r"diagnosis\.gap\.before: expected a number ≥ 0, got '67'"),
        (
            lambda d: d["where"][0].update(share=1.2),
            r"diagnosis\.where\[0\]\.share: expected a number from 0 to 1",
        ),
        (lambda d: d.update(gap=None), r"diagnosis\.gap: null"),
        (lambda d: d.update(causes=[{"effect": "x"}]), r"diagnosis\.causes\[0\]\.layer: missing"),
        (lambda d: d["gap"].update(shrink_ci95=[1, 0]), r"shrink_ci95: expected \[lower, upper\]"),
    ],
)
def test_validation_names_the_wrong_key(make_logs, right_model, change, message):
    logs = make_logs(seconds=3.0, effect=deadband)
    content = json.loads(json.dumps(diagnose(logs, right_model(logs)).content))
    validate_diagnosis(content)
    change(content)
    with pytest.raises(ConfigError, match=message):
        validate_diagnosis(content)


def test_the_published_example_is_valid():
    validate_diagnosis(
        {
            "format": "hqpipe-diagnosis/1",
            "verdict": "explained",
            "logs": {"path": "x", "sha256": "y", "trials": 5, "joints": ["LFR"], "control_mode": "position"},
            "gap": {
                "layer": "actuator",
                "metric": "free_run_rmse",
                "unit": "N·m",
                "window_s": 0.1,
                "before": 67.4,
                "after": 6.3,
                "noise_floor": 2.1,
                "persistence": 91.0,
                "shrink": 0.91,
                "shrink_ci95": [0.89, 0.92],
            },
            "where": [{"layer": "actuator", "joint": "LFK", "regime": "extending", "share": 0.31}],
            "causes": [
                {
                    "effect": "valve_deadband",
                    "layer": "actuator",
                    "joints": ["LFK"],
                    "scope": "joint",
                    "probability": 0.98,
                    "parameters": {"half_width": {"value": 0.0062, "unit": "rad", "ci95": [0.0060, 0.0065]}},
                    "shrink": 0.22,
                    "shrink_ci95": [0.19, 0.25],
                    "confused_with": [],
                }
            ],
            "effects_considered": [],
            "unexplained": {"share_of_gap": 0.02, "above_noise": False, "where": [], "depends_on": []},
            "next_experiment": None,
            "warnings": [],
        }
    )
