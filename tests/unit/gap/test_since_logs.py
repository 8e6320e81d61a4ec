"""What changed since earlier logs or an earlier model: a small library, so that it stays short."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, values
from planted_logs import logs_of, planted, size

from hqpipe.actuators.files import load_actuator, save_actuator
from hqpipe.effects import EFFECTS
from hqpipe.effects.layout import slot
from hqpipe.errors import ConfigError, IdentificationError
from hqpipe.gap.causes import assemble
from hqpipe.gap.changes import CHANGES
from hqpipe.gap.diagnosis import FILE, diagnose, write_diagnosis
from hqpipe.gap.joint_state import search_joints
from hqpipe.gap.schema import read_diagnosis, validate_diagnosis
from hqpipe.gap.since import earlier_actuator
from hqpipe.gap.since_logs import earlier_logs
from hqpipe.gap.unchanged import REASON, drop_unchanged
from hqpipe.sysid.fit_actuator import fit_actuator

KEPT = (*CHANGES, "torque_scale", "valve_deadband", "valve_lag", "unsigned_sensor")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)
BAND = {"valve_deadband": {"half_width": 0.03, "rounding": 0.2}}
LEAK = planted.leaking(1.0, 1.8)


def since(earlier, logs):
    return diagnose(logs, without=WITHOUT, earlier=earlier).content


def named(content):
    return {(cause["effect"], tuple(cause["joints"])) for cause in content["causes"]}


@pytest.fixture(scope="module")
def sound():
    return logs_of([{}, {}])


@pytest.fixture(scope="module")
def earlier(sound):
    return earlier_logs(sound, 0.1, WITHOUT)


@pytest.fixture(scope="module")
def leaking():
    return logs_of([{}, {}], seed=1, gains=LEAK)


@pytest.fixture(scope="module")
def found(earlier, leaking):
    return diagnose(leaking, without=WITHOUT, earlier=earlier)


def test_the_same_machine_again_has_not_changed(earlier):
    content = since(earlier, logs_of([{}, {}], seed=3))
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert content["gap"]["before"] == pytest.approx(content["gap"]["noise_floor"], rel=0.15)
    assert content["reference"] == {"path": "synthetic", "kind": "logs", "sha256": "0" * 64}
    considered = {row["effect"] for row in content["effects_considered"]}
    assert considered >= set(CHANGES) | {"torque_scale", "valve_lag"}


def flipped(logs, j):
    return broken(logs, values("effort", np.negative, j))


def test_a_joint_that_either_record_left_out_is_not_compared_and_the_others_are(sound, earlier, leaking):
    part = since(earlier_logs(flipped(sound, 0), 0.1, WITHOUT), leaking)
    assert part["logs"]["joints"] == [sound.joints[1]] and named(part) == {("leakage_change", sound.joints[1:])}
    (left,) = part["left_out"]
    assert (left["kind"], left["joints"]) == ("not_in_reference", [sound.joints[0]])
    other = since(earlier, flipped(leaking, 0))
    assert named(other) == {("leakage_change", sound.joints[1:])}
    assert [(x["kind"], x["joints"]) for x in other["left_out"]] == [("sign_flipped", [sound.joints[0]])]
    nothing = since(earlier_logs(flipped(sound, 0), 0.1, WITHOUT), flipped(leaking, 1))
    assert nothing["verdict"] == "not_identifiable" and len(nothing["left_out"]) == 2


def test_grown_leakage_is_named_with_its_ratio(leaking, found):
    content = found.content
    assert content["verdict"] == "explained"
    assert named(content) == {("leakage_change", leaking.joints[1:])}
    ratio = content["causes"][0]["parameters"]["ratio"]
    assert ratio["value"] == pytest.approx(1.8, rel=0.1) and ratio["ci95"][0] <= 1.8 <= ratio["ci95"][1]
    assert "reference" not in ratio, "it is a ratio to the reference"
    assert content["gap"]["before"] > 10.0 * content["gap"]["after"]
    assert content["where"][0]["joint"] == leaking.joints[1]


@pytest.mark.parametrize("kind", ["fit", "diagnosis"])
def test_what_a_model_always_lacked_grows_with_the_motion_and_is_no_change(tmp_path, kind):
    lag, without = [size("valve_lag"), {}], (*WITHOUT, "valve_lag")
    then = logs_of(lag, seed=1, motion=0.15, knocks=200.0)
    if kind == "fit":
        fit = fit_actuator(then)
        save_actuator(fit.model, tmp_path)
        (tmp_path / "fit.json").write_text(json.dumps({"per_joint": fit.to_dict()}))
    else:
        write_diagnosis(diagnose(then, without=without), tmp_path)
    earlier = earlier_actuator(tmp_path)
    content = diagnose(logs_of(lag, seed=3), without=without, earlier=earlier).content
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert not any("how much its own logs moved" in text for text in content["warnings"])


def test_the_saved_actuator_is_the_machine_of_now(found, earlier, tmp_path):
    write_diagnosis(found, tmp_path)
    assert read_diagnosis(tmp_path / FILE)["reference"]["kind"] == "logs"
    model = load_actuator(tmp_path)
    then = np.array([earlier.then[joint].row for joint in model.joints])
    k1, k2, k3 = (list(model.FIELDS).index(name) for name in ("k1", "k2", "k3"))
    np.testing.assert_allclose(model.parameters[0], then[0])
    gains = [k1, k2, k3]
    now = dict(zip(gains, model.parameters[1, gains] / then[1, gains], strict=True))
    assert now[k2] == pytest.approx(LEAK["k2"][1], rel=0.03)
    assert [now[k1], now[k3]] == pytest.approx([LEAK["k1"][1]] * 2, rel=0.002), "more leaks away within a sample"


def test_the_model_of_a_diagnosis_is_a_reference_too(sound, leaking, tmp_path):
    write_diagnosis(diagnose(sound, without=WITHOUT), tmp_path)
    content = since(earlier_actuator(tmp_path), leaking)
    assert named(content) == {("leakage_change", leaking.joints[1:])}
    assert content["causes"][0]["parameters"]["ratio"]["value"] == pytest.approx(1.8, rel=0.1)
    assert content["reference"]["kind"] == "actuator"
    assert any("no intervals" in text for text in content["warnings"])


def test_an_effect_that_grew_and_one_that_is_new():
    earlier = earlier_logs(logs_of([size("valve_deadband"), {}]), 0.1, WITHOUT)
    content = since(earlier, logs_of([BAND, size("valve_lag")], seed=1))
    assert content["verdict"] == "explained"
    causes = {cause["effect"]: cause for cause in content["causes"]}
    assert {(name, *cause["joints"]) for name, cause in causes.items()} == {
        ("valve_deadband", "LFR"),
        ("valve_lag", "LFP"),
    }
    width = causes["valve_deadband"]["parameters"]["half_width"]
    assert width["value"] == pytest.approx(0.03, rel=0.05) and width["reference"] == pytest.approx(0.02, rel=0.05)
    lag = causes["valve_lag"]["parameters"]["time_constant_s"]
    assert lag["value"] == pytest.approx(0.012, rel=0.1) and lag["reference"] is None


def test_an_effect_that_was_there_before_is_no_cause():
    then = [size("valve_deadband"), {}]
    content = since(earlier_logs(logs_of(then), 0.1, WITHOUT), logs_of(then, seed=1))
    assert content["verdict"] == "no_gap" and content["causes"] == []


def test_softer_oil_is_one_change_and_not_four(earlier):
    content = since(earlier, logs_of([{}, {}], seed=1, gains=dict.fromkeys(("k1", "k2", "k3", "k4"), [0.75, 1.0])))
    assert named(content) == {("stiffness_change", ("LFR",))}
    (cause,) = content["causes"]
    assert cause["parameters"]["ratio"]["value"] == pytest.approx(0.75, rel=0.05)
    assert "transmission_compliance" in cause["confused_with"]


def test_a_torque_sensor_of_another_gain_changes_no_actuator(earlier):
    scaled = logs_of([{}, {}], seed=1)
    trials = tuple(
        replace(t, trajectory=replace(t.trajectory, effort=t.trajectory.effort * np.array([1.15, 1.0])))
        for t in scaled.trials
    )
    found = diagnose(replace(scaled, trials=trials), without=WITHOUT, earlier=earlier)
    assert named(found.content) == {("torque_scale", ("LFR",))}
    assert found.content["causes"][0]["parameters"]["ratio"]["value"] == pytest.approx(1.15, rel=0.03)
    then = np.array([earlier.then[joint].row for joint in found.augmented.joints])
    np.testing.assert_allclose(found.augmented.parameters, then, rtol=1e-9)


def test_a_difference_within_what_is_uncertain_about_the_record_is_no_change(earlier, leaking):
    """The same leakage, beside a record that knows its leakage to ± 80 % only."""
    joint = leaking.joints[1]
    then = earlier.then[joint]
    at = int(np.flatnonzero(then.columns == slot("base", "k2"))[0])
    wide = then.covariance.copy()
    wide[at, at] = (0.8 * then.row[then.columns[at]]) ** 2
    vague = replace(earlier, then=earlier.then | {joint: replace(then, covariance=wide)})
    content = since(vague, leaking)
    assert "leakage_change" not in {cause["effect"] for cause in content["causes"]}
    reasons = {row["effect"]: row["reason"] for row in content["effects_considered"]}
    assert reasons["leakage_change"] == REASON


def test_what_the_record_misses_on_its_own_logs_is_no_change(earlier, leaking):
    """A reference that was as wrong when it was made says nothing about what changed."""
    then = {joint: replace(t, familiar=0.5 * t.swing) for joint, t in earlier.then.items()}
    content = since(replace(earlier, then=then), logs_of([{}, {}], seed=3))
    assert content["verdict"] == "no_gap"
    assert any("no better than" in text for text in content["warnings"])


def test_what_a_record_lacked_is_not_new(sound, tmp_path):
    """A model without the deadband that the machine has had all along: it errs as it did, and then leaks besides."""
    band = [size("valve_deadband"), {}]
    lacking = (*WITHOUT, "valve_deadband", "valve_lag")
    write_diagnosis(diagnose(logs_of(band), without=lacking), tmp_path)
    earlier = earlier_actuator(tmp_path)
    content = since(earlier, logs_of(band, seed=1))
    assert content["verdict"] == "no_gap" and content["causes"] == []
    leaks = since(earlier, logs_of(band, seed=1, gains=planted.leaking(1.0, 1.8)))
    assert named(leaks) == {("leakage_change", ("LFP",))}


def test_logs_that_cannot_be_diagnosed_are_no_reference(sound):
    short = tuple(replace(t, trajectory=t.trajectory.section(0, 500)) for t in sound.trials)
    with pytest.raises(IdentificationError, match="reference synthetic: .*windows"):
        earlier_logs(replace(sound, trials=short), 0.1, WITHOUT)


def test_the_file_holds_what_it_was_then(found):
    content = json.loads(json.dumps(found.content))
    content["causes"][0]["parameters"]["ratio"]["reference"] = None
    validate_diagnosis(content)
    content["reference"]["kind"] = "model"
    with pytest.raises(ConfigError, match=r"diagnosis\.reference\.kind: expected logs \| actuator"):
        validate_diagnosis(content)


def test_search_and_filter_agree_on_an_unchanged_joint(earlier, sound):
    from hqpipe.gap.accuse import prepare

    data, _ = prepare(sound, KEPT, 100, None, None, earlier)
    states = search_joints(data, ("gain_change", "leakage_change"))
    floor = np.array([state.base.error for state in states])
    assert assemble(drop_unchanged(states, floor), floor) == []
