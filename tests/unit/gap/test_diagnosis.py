"""The diagnosis as a whole: verdicts, causes, place, files."""

from __future__ import annotations

import csv
import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, rows, values
from planted_logs import logs_of, size

from hqpipe.actuators.files import load_actuator
from hqpipe.errors import ConfigError, IdentificationError
from hqpipe.gap.answer.schema import read_diagnosis, validate_diagnosis
from hqpipe.gap.diagnosis import FILE, TABLE, TRACES, diagnose, write_diagnosis
from hqpipe.machine import EFFECTS

# A part of the library keeps these tests short; the search itself is tested with more.
KEPT = ("command_delay", "valve_lag", "valve_deadband", "torque_bias", "unsigned_sensor")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)


def verdict(logs, **kwargs):
    return diagnose(logs, **({"without": WITHOUT} | kwargs)).content


def named(content):
    return {(cause["effect"], tuple(cause["joints"])) for cause in content["causes"]}


@pytest.fixture(scope="module")
def sound():
    return logs_of([{}, {}])


@pytest.fixture(scope="module")
def planted_logs():
    """A deadband in the second of three joints."""
    return logs_of([{}, size("valve_deadband"), {}])


@pytest.fixture(scope="module")
def found(planted_logs):
    return diagnose(planted_logs, without=WITHOUT)


@pytest.mark.parametrize("seed,noise", [(1, 3.0), (2, 6.0), (3, 1.0)])
def test_noise_alone_is_no_gap(seed, noise):
    content = verdict(logs_of([{}, {}], seed=seed, noise=noise))
    assert content["verdict"] == "no_gap"
    gap = content["gap"]
    assert gap["before"] == gap["after"] == pytest.approx(gap["noise_floor"], rel=0.15)
    assert gap["shrink"] == 0.0 and gap["persistence"] > 10.0 * gap["before"]
    assert content["where"] == content["causes"] == []
    assert not content["unexplained"]["above_noise"]
    assert {row["effect"] for row in content["effects_considered"]} >= set(KEPT) - {"unsigned_sensor"}


def test_planted_effect_explains_the_gap(planted_logs, found):
    content = found.content
    joint = planted_logs.joints[1]
    assert content["verdict"] == "explained"
    assert named(content) == {("valve_deadband", (joint,))}
    (cause,) = content["causes"]
    width = cause["parameters"]["half_width"]
    assert width["unit"] == "rad" and width["value"] == pytest.approx(0.02, rel=0.03)
    assert width["ci95"][0] < width["value"] < width["ci95"][1]
    assert cause["scope"] == "joint" and cause["probability"] > 0.8 and cause["confused_with"] == []
    assert content["where"][0]["joint"] == joint
    assert all(place["joint"] == joint for place in content["where"])
    gap = content["gap"]
    assert gap["after"] == pytest.approx(gap["noise_floor"], rel=0.15)
    sizes = gap["normalised"]
    assert gap["shrink"] == pytest.approx(1.0 - sizes["after"] / sizes["before"], abs=1e-5)
    assert gap["shrink_ci95"][0] <= gap["shrink"] <= gap["shrink_ci95"][1]
    assert cause["shrink"] == pytest.approx(gap["shrink"], abs=1e-3)
    assert not content["unexplained"]["above_noise"] and content["next_experiment"] is None


def test_claimed_shrink_is_what_the_replay_shows(found):
    shown = {row.before.joint: row for row in found.table if (row.trial, row.before.family) == ("all", "all")}
    assert len(shown) == 3
    before = np.sqrt(np.mean([row.before.rmse**2 for row in shown.values()]))
    after = np.sqrt(np.mean([row.after.rmse**2 for row in shown.values()]))
    assert found.content["gap"]["before"] == pytest.approx(before, rel=1e-4)
    assert found.content["gap"]["after"] == pytest.approx(after, rel=1e-4)


def test_augmented_actuator_holds_what_was_found(planted_logs, found):
    assert found.augmented.effects["valve_deadband"] == (planted_logs.joints[1],)
    width = found.augmented.parameters[1, list(found.augmented.FIELDS).index("valve_deadband_half_width")]
    assert width == pytest.approx(0.02, rel=0.03)
    assert found.augmented.dt == pytest.approx(1e-3)


def test_without_the_true_effect_its_name_is_not_used_and_the_place_is_right(planted_logs):
    content = verdict(planted_logs, without=(*WITHOUT, "valve_deadband"))
    assert content["verdict"] == "unknown" and content["causes"] == []
    assert content["where"][0]["joint"] == planted_logs.joints[1]
    unexplained = content["unexplained"]
    assert unexplained["above_noise"] and unexplained["share_of_gap"] == 1.0
    assert {place["joint"] for place in unexplained["where"]} == {planted_logs.joints[1]}
    assert unexplained["depends_on"][0]["joints"] == [planted_logs.joints[1]]
    gap = content["gap"]
    assert gap["after"] == pytest.approx(gap["before"], rel=1e-3)
    assert gap["before"] > 2.0 * gap["noise_floor"]
    assert planted_logs.joints[1] in content["next_experiment"]
    assert "valve_deadband" not in {row["effect"] for row in content["effects_considered"]}


def test_disturbance_that_no_signal_predicts_is_unknown(sound):
    def hum(t):
        return replace(t, effort=t.effort + 40.0 * np.sin(2 * np.pi * 7.3 * t.time)[:, None] * [1.0, 0.0])

    content = verdict(broken(sound, hum, only=[1]))
    assert content["verdict"] == "unknown" and content["causes"] == []
    assert any("no logged signal predicts" in text for text in content["warnings"])


def test_lost_sign_is_a_cause_and_the_rest_is_judged_after_it(sound):
    content = verdict(broken(sound, values("effort", np.abs, 0)))
    assert named(content) == {("unsigned_sensor", sound.joints[:1])}
    assert content["verdict"] == "explained"


def test_what_is_left_is_a_share_of_the_gap_that_the_sign_made_too():
    logs = logs_of([size("gain_drift"), {}], seconds=6.0)  # which the library here lacks
    content = verdict(broken(logs, values("effort", np.abs, 0)))
    gap = content["gap"]
    gap = gap["normalised"]
    before, after = (gap[name] ** 2 - gap["noise_floor"] ** 2 for name in ("before", "after"))
    assert named(content) == {("unsigned_sensor", logs.joints[:1])}
    assert content["unexplained"]["share_of_gap"] == pytest.approx(after / before, rel=0.1)


def test_half_a_second_is_not_identifiable(sound):
    content = verdict(broken(sound, lambda t: t.section(0, 500)))
    assert content["verdict"] == "not_identifiable" and content["gap"] is None and content["causes"] == []
    assert any("windows" in text for text in content["warnings"]) and content["next_experiment"]


def test_shuffled_rows_are_not_identifiable(sound):
    def order(samples):
        return np.random.default_rng(0).permutation(samples)

    content = verdict(broken(sound, rows(order)))
    assert content["verdict"] == "not_identifiable" and content["gap"] is None


def test_swapped_channels_cost_their_joints_only(tmp_path):
    logs = logs_of([{}, {}, size("valve_deadband")])
    swapped = broken(logs, lambda t: replace(t, position_command=t.position_command[:, [1, 0, 2]]))
    found = diagnose(swapped, without=WITHOUT)
    content = found.content
    assert named(content) == {("valve_deadband", logs.joints[2:])} and content["logs"]["joints"] == [logs.joints[2]]
    (left,) = content["left_out"]
    assert (left["kind"], left["joints"], left["channel"]) == ("swapped", list(logs.joints[:2]), None)
    assert "swapped in every trial" in left["reason"] and left["fix"] == "rename the columns"
    write_diagnosis(found, tmp_path)
    assert read_diagnosis(tmp_path / FILE)["left_out"] == [left]
    assert load_actuator(tmp_path).joints == logs.joints
    assert any("actuator.json" in text and logs.joints[0] in text for text in content["warnings"])


def test_the_model_of_a_joint_that_was_left_out_is_that_of_the_mended_logs():
    logs = logs_of([{}, {}, {}])
    flipped = broken(logs, values("effort", np.negative, 1))
    found, sound = (diagnose(x, without=WITHOUT) for x in (flipped, logs))
    assert found.content["logs"]["joints"] == [logs.joints[0], logs.joints[2]]
    assert found.augmented.joints == logs.joints
    np.testing.assert_allclose(found.augmented.parameters[:, :4], sound.augmented.parameters[:, :4], rtol=0.02)


def test_a_joint_without_any_sound_log_leaves_no_model_and_says_why():
    logs = logs_of([{}, {}, {}])
    found = diagnose(broken(logs, values("effort", lambda v: 0.0 * v, 1)), without=WITHOUT)
    assert found.verdict == "no_gap" and found.augmented is None
    assert any(
        text.startswith(f"no actuator.json: no sound logs of {logs.joints[1]}") for text in found.content["warnings"]
    )


def test_one_rotten_trial_costs_that_trial(sound):
    trials = (*sound.trials, replace(sound.trials[0], file="again.parquet"))
    mixed = rows(lambda n: np.random.default_rng(0).permutation(n))
    rotten = broken(replace(sound, trials=trials), mixed, only=[len(trials) - 1])
    content = verdict(rotten)
    assert content["verdict"] == "no_gap" and content["logs"]["joints"] == list(sound.joints)
    (left,) = content["left_out"]
    assert left["trials"] == ["again.parquet"] and left["joints"] == [] and left["kind"] == "rows_out_of_order"


def test_effort_limits_are_those_of_the_joints_that_are_left():
    logs = logs_of([{}, {}, {}])
    flipped = broken(logs, values("effort", np.negative, 0))
    found = diagnose(flipped, without=WITHOUT, effort_limit=np.array([100.0, 1e6, 1e6]))
    assert found.verdict == "no_gap", "the limit of the first joint would cut the torques of the second"


def test_no_motion_is_not_identifiable(sound):
    def still(t):
        noise = np.random.default_rng(0).standard_normal(t.position.shape)
        quiet = {name: 0.0 * getattr(t, name) for name in ("position", "velocity", "position_command")}
        return replace(t, **quiet, effort=3.0 * noise)

    content = verdict(broken(sound, still))
    assert content["verdict"] == "not_identifiable" and content["causes"] == []


def test_without_held_out_trials_nothing_is_claimed(sound):
    assert verdict(replace(sound, trials=sound.trials[:1]))["verdict"] == "not_identifiable"


def test_trial_shorter_than_a_window_is_left_out_and_said(sound):
    short = replace(sound.trials[0], file="stub.parquet", trajectory=sound.trials[0].trajectory.section(0, 60))
    content = verdict(replace(sound, trials=(*sound.trials, short)))
    assert content["verdict"] == "no_gap"
    (left,) = content["left_out"]
    assert left["trials"] == ["stub.parquet"] and "stub.parquet: shorter than one window" in left["reason"]


def test_without_commands_and_with_a_free_base_only_sensing_is_evaluated(sound):
    bare = replace(broken(sound, lambda t: replace(t, position_command=None)), base="floating")
    bare = replace(bare, trials=tuple(replace(trial, base=None) for trial in bare.trials))
    for logs in (bare, replace(bare, control_mode=None)):
        content = verdict(logs)
        assert content["verdict"] == "not_identifiable" and content["gap"] is None
        assert any("joint/<name>/position_command" in text for text in content["warnings"])


def test_without_effort_and_command_no_layer_is_left(sound):
    with pytest.raises(IdentificationError, match="joint/<name>/effort"):
        diagnose(broken(sound, lambda t: replace(t, effort=None, position_command=None)))


def test_files_are_valid_and_the_same_whoever_works(planted_logs, found, tmp_path):
    write_diagnosis(found, tmp_path / "one")
    again = diagnose(planted_logs, without=WITHOUT, workers=3)
    write_diagnosis(again, tmp_path / "two")
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert {FILE, TABLE, TRACES, "actuator.json"} <= set(names)
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name
    content = read_diagnosis(tmp_path / "one" / FILE)
    assert content == json.loads(json.dumps(found.content))
    actuator = load_actuator(tmp_path / "one")
    np.testing.assert_allclose(actuator.parameters, found.augmented.parameters)
    with (tmp_path / "one" / TABLE).open() as stream:
        table = list(csv.DictReader(stream))
    assert {row["trial"] for row in table} == {"all", planted_logs.heldout[0].file}
    whole = [row for row in table if row["trial"] == "all" and row["family"] == "direction"]
    assert sum(float(row["share"]) for row in whole) == pytest.approx(1.0, abs=1e-5)
    assert all(float(row["rmse_after"]) <= float(row["rmse"]) * 1.05 for row in whole)
    traces = json.loads((tmp_path / "one" / TRACES).read_text())
    assert set(traces["joints"]) == set(planted_logs.joints)


def test_order_of_the_joints_does_not_matter(planted_logs, found):
    names = planted_logs.joints[::-1]
    turned = replace(broken(planted_logs, lambda t: t.for_joints(names)), joints=names)
    content = verdict(turned)
    assert named(content) == named(found.content)
    assert content["gap"]["before"] == pytest.approx(found.content["gap"]["before"], rel=1e-6)
    assert content["causes"][0]["parameters"]["half_width"]["value"] == pytest.approx(
        found.content["causes"][0]["parameters"]["half_width"]["value"], rel=1e-6
    )


def test_progress_is_told_to_the_end(sound):
    steps = []
    verdict(sound, progress=lambda done, total, text: steps.append((done, total)))
    assert steps and steps[-1][0] == steps[-1][1]


@pytest.mark.parametrize(
    "change,message",
    [
        (lambda d: d.update(verdic="no_gap"), r"diagnosis\.verdic: unknown key.*did you mean 'verdict'"),
        (lambda d: d.pop("logs"), r"diagnosis\.logs: missing"),
        (lambda d: d["gap"].update(before="67"), r"diagnosis\.gap\.before: expected a number ≥ 0, got '67'"),
        (lambda d: d["where"][0].update(share=1.2), r"diagnosis\.where\[0\]\.share: expected a number from 0 to 1"),
        (lambda d: d.update(gap=None), r"diagnosis\.gap: null"),
        (lambda d: d["causes"][0].pop("layer"), r"diagnosis\.causes\[0\]\.layer: missing"),
        (lambda d: d["gap"].update(shrink_ci95=[1, 0]), r"shrink_ci95: expected \[lower, upper\]"),
        (lambda d: d["gap"].update(shrink=1.1), r"gap\.shrink: expected a number ≤ 1"),
        (lambda d: d["causes"][0].update(scope="leg"), r"causes\[0\]\.scope: expected joint \| group \| machine"),
        (lambda d: d["causes"][0].update(probability=2.0), r"causes\[0\]\.probability: expected a number from 0 to 1"),
        (
            lambda d: d["causes"][0]["parameters"]["half_width"].pop("unit"),
            r"causes\[0\]\.parameters\.half_width\.unit: missing",
        ),
        (
            lambda d: d["effects_considered"][0].update(score=float("nan")),
            r"effects_considered\[0\]\.score: expected a number",
        ),
        (lambda d: d["unexplained"].update(above_noise=1), r"unexplained\.above_noise: expected true or false"),
        (lambda d: d["logs"].update(trials=-1), r"logs\.trials: expected a whole number"),
    ],
)
def test_validation_names_the_wrong_key(found, change, message):
    content = deepcopy(found.content)
    validate_diagnosis(content)
    change(content)
    with pytest.raises(ConfigError, match=message):
        validate_diagnosis(content)


def test_the_published_example_is_valid():
    validate_diagnosis(
        {
            "format": "hqpipe-diagnosis/2",
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
                "normalised": {"before": 0.31, "after": 0.03, "noise_floor": 0.01, "persistence": 0.42},
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
