"""What changed since earlier logs or an earlier model: a small library, so that it stays short."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, values
from planted_logs import logs_of, planted, size

from hqpipe.actuators.files import load_actuator, save_actuator
from hqpipe.errors import ConfigError, IdentificationError
from hqpipe.gap.answer.schema import read_diagnosis, validate_diagnosis
from hqpipe.gap.change.since import EarlierLogs, earlier_actuator
from hqpipe.gap.diagnosis import FILE, diagnose, write_diagnosis
from hqpipe.identify.paper_model.fit_actuator import fit_actuator
from hqpipe.layers.actuator.changes import MULTIPLIES
from hqpipe.machine import EFFECTS

KEPT = (*MULTIPLIES, "valve_deadband", "valve_lag", "unsigned_sensor")
WITHOUT = tuple(name for name in EFFECTS if name not in KEPT)
BAND = {"valve_deadband": {"half_width": 0.03, "rounding": 0.2}}
LEAK = planted.leaking(1.0, 1.8)


def since(earlier, logs):
    return diagnose(logs, without=WITHOUT, earlier=earlier).content


def parameters(content, effect):
    return next(cause["parameters"] for cause in content["causes"] if cause["effect"] == effect)


def named(content):
    return {(cause["effect"], tuple(cause["joints"])) for cause in content["causes"]}


@pytest.fixture(scope="module")
def sound():
    return logs_of([{}, {}])


@pytest.fixture(scope="module")
def earlier(sound):
    return EarlierLogs(sound)


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
    assert considered >= {*MULTIPLIES, "valve_lag"}


def flipped(logs, j):
    return broken(logs, values("effort", np.negative, j))


def test_a_joint_that_either_record_left_out_is_not_compared_and_the_others_are(sound, earlier, leaking):
    part = since(EarlierLogs(flipped(sound, 0)), leaking)
    assert part["logs"]["joints"] == [sound.joints[1]] and named(part) == {("leakage_change", sound.joints[1:])}
    (left,) = part["left_out"]
    assert (left["kind"], left["joints"]) == ("not_in_reference", [sound.joints[0]])
    other = since(earlier, flipped(leaking, 0))
    assert named(other) == {("leakage_change", sound.joints[1:])}
    assert [(x["kind"], x["joints"]) for x in other["left_out"]] == [("sign_flipped", [sound.joints[0]])]
    nothing = since(EarlierLogs(flipped(sound, 0)), flipped(leaking, 1))
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


def test_the_saved_actuator_is_the_machine_of_now(found, tmp_path):
    write_diagnosis(found, tmp_path)
    assert read_diagnosis(tmp_path / FILE)["reference"]["kind"] == "logs"
    model, then = load_actuator(tmp_path), found.base.parameters
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
    earlier = EarlierLogs(logs_of([size("valve_deadband"), {}]))
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


@pytest.mark.parametrize("left", [{}, {"valve_deadband": {"half_width": 0.002, "rounding": 0.2}}])
@pytest.mark.parametrize("kind", ["logs", "model"])
def test_an_effect_that_was_mended_is_a_change(tmp_path, kind, left):
    then = logs_of([size("valve_deadband"), {}])
    if kind == "model":
        write_diagnosis(diagnose(then, without=WITHOUT), tmp_path)
    earlier = EarlierLogs(then) if kind == "logs" else earlier_actuator(tmp_path)
    content = since(earlier, logs_of([left, {}], seed=1))
    assert content["verdict"] == "explained" and named(content) == {("valve_deadband", ("LFR",))}
    width = content["causes"][0]["parameters"]["half_width"]
    assert width["reference"] == pytest.approx(0.02, rel=0.05)
    assert width["value"] == pytest.approx(0.002 if left else 0.0, abs=5e-4)


def test_an_effect_that_was_there_before_is_no_cause():
    then = [size("valve_deadband"), {}]
    content = since(EarlierLogs(logs_of(then)), logs_of(then, seed=1))
    assert content["verdict"] == "no_gap" and content["causes"] == []


def test_softer_oil_is_one_change_and_not_four(earlier):
    content = since(earlier, logs_of([{}, {}], seed=1, gains=dict.fromkeys(("k1", "k2", "k3", "k4"), [0.75, 1.0])))
    assert named(content) == {("stiffness_change", ("LFR",))}
    (cause,) = content["causes"]
    assert cause["parameters"]["ratio"]["value"] == pytest.approx(0.75, rel=0.05)


def test_softer_oil_is_told_with_the_transmission_that_looks_the_same(earlier):
    content = since(earlier, logs_of([{}, {}], seed=1, gains=dict.fromkeys(("k1", "k2", "k3", "k4"), [0.75, 1.0])))
    assert "transmission_compliance" in content["causes"][0]["confused_with"]


def test_a_torque_sensor_of_another_gain_changes_no_actuator(earlier):
    scaled = logs_of([{}, {}], seed=1)
    trials = tuple(
        replace(t, trajectory=replace(t.trajectory, effort=t.trajectory.effort * np.array([1.15, 1.0])))
        for t in scaled.trials
    )
    found = diagnose(replace(scaled, trials=trials), without=WITHOUT, earlier=earlier)
    assert named(found.content) == {("torque_scale", ("LFR",))}
    assert found.content["causes"][0]["parameters"]["ratio"]["value"] == pytest.approx(1.15, rel=0.03)
    np.testing.assert_allclose(found.augmented.parameters, found.base.parameters, rtol=1e-9)


@pytest.mark.parametrize("unsure", [0.2, 1.6])
def test_what_is_uncertain_about_the_record_is_in_the_interval(leaking, tmp_path, unsure):
    """The same leakage, beside a model whose intervals leave its own open by this share: more than it grew by is no change."""
    fit = fit_actuator(logs_of([{}, {}]))
    save_actuator(fit.model, tmp_path)
    content = fit.to_dict()
    for joint in content["fits"]:
        for number in joint["coefficients"]:
            number["ci95"] = [(1.0 - unsure) * number["value"], (1.0 + unsure) * number["value"]]
    (tmp_path / "fit.json").write_text(json.dumps({"per_joint": content}))
    told = since(earlier_actuator(tmp_path), leaking)
    if unsure < 1.0:
        ratio = parameters(told, "leakage_change")["ratio"]
        assert ratio["ci95"] == pytest.approx([1.8 * (1.0 - unsure), 1.8 * (1.0 + unsure)], rel=0.1)
    else:
        assert told["verdict"] == "unknown" and told["causes"] == []
        (row,) = [row for row in told["effects_considered"] if row["effect"] == "leakage_change"]
        assert row["reason"] == "its interval holds what the reference says"


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
        since(EarlierLogs(replace(sound, trials=short)), sound)


def test_the_file_holds_what_it_was_then(found):
    content = json.loads(json.dumps(found.content))
    content["causes"][0]["parameters"]["ratio"]["reference"] = None
    validate_diagnosis(content)
    content["reference"]["kind"] = "model"
    with pytest.raises(ConfigError, match=r"diagnosis\.reference\.kind: expected logs \| actuator"):
        validate_diagnosis(content)
