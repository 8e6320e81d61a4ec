"""Torque and valve mode: a machine that is its base model has no gap, and a planted effect is named with its size."""

from __future__ import annotations

from dataclasses import replace

import pytest
from control_mode_truth import JOINTS, NOISE, log_set

from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.diagnosis import diagnose

SAMPLE_S = 1e-3


def only_cause(content, effect):
    """The one cause, which must be `effect` in all joints."""
    assert content["verdict"] == "explained"
    assert [cause["effect"] for cause in content["causes"]] == [effect]
    assert content["causes"][0]["joints"] == list(JOINTS)
    return content["causes"][0]["parameters"]


@pytest.mark.parametrize("leak", [0.0, 0.05])
def test_a_force_loop_has_no_gap_with_or_without_leak(leak):
    content = diagnose(log_set("torque", leak=leak)).content
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert content["gap"]["before"] == pytest.approx(content["gap"]["noise_floor"], rel=0.08)
    assert content["gap"]["before"] < 1.1 * NOISE["torque"] and content["gap"]["unit"] == "N·m"


@pytest.mark.parametrize(
    "effect,planted,parameter,value",
    [
        ("command_delay", {"delay": 5e-3}, "delay_s", 5e-3),
        ("valve_deadband", {"deadband": 6.0}, "half_width", 6.0),
        ("integral_action", {"integral_gain": 5.0}, "ki", 5.0),
    ],
)
def test_torque_mode_names_the_effect_and_its_size(effect, planted, parameter, value):
    content = diagnose(log_set("torque", **planted)).content
    # A delay is told to one sample, since logs do not say which row the command belongs to.
    within = 0.6 * SAMPLE_S if effect == "command_delay" else 0.05 * value
    assert only_cause(content, effect)[parameter]["value"] == pytest.approx(value, abs=within)


@pytest.mark.parametrize(
    "answers_to,inclusive,load", [(0, False, True), (0, True, False), (1, False, False), (1, True, True)]
)
def test_a_rate_controlled_axis_has_no_gap_whatever_row_the_command_stands_in(answers_to, inclusive, load):
    content = diagnose(log_set("valve", answers_to=answers_to, inclusive=inclusive, load=load)).content
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert content["gap"]["before"] < 1.1 * NOISE["valve"] and content["gap"]["unit"] == "rad/s"


@pytest.mark.parametrize(
    "effect,planted,parameter,value",
    [
        ("valve_lag", {"lag": 8e-3, "answers_to": 1}, "time_constant_s", 8e-3),
        ("valve_deadband", {"deadband": 0.03, "load": True}, "half_width", 0.03),
        ("flow_saturation", {"limit": 0.5}, "limit", 0.5),
    ],
)
def test_valve_mode_names_the_effect_and_its_size(effect, planted, parameter, value):
    content = diagnose(log_set("valve", **planted)).content
    assert only_cause(content, effect)[parameter]["value"] == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize("answers_to,inclusive", [(0, False), (0, True), (1, True)])
def test_a_delay_is_told_to_one_sample_in_any_row_convention(answers_to, inclusive):
    content = diagnose(log_set("valve", delay=5e-3, answers_to=answers_to, inclusive=inclusive)).content
    delay = only_cause(content, "command_delay")["delay_s"]
    assert delay["value"] == pytest.approx(5e-3, abs=0.6 * SAMPLE_S)
    assert delay["ci95"][0] <= 5e-3 <= delay["ci95"][1]


def test_without_torque_no_effect_of_the_load_is_considered():
    content = diagnose(log_set("valve")).content
    names = {row["effect"] for row in content["effects_considered"]}
    assert "valve_lag" in names and not {"orifice_flow", "transmission_compliance"} & names


def floating(**effect):
    """The logs of a force loop on a base that moves."""
    return replace(log_set("torque", **effect), base="floating")


@pytest.mark.parametrize("earlier", [False, True])
def test_a_force_loop_on_a_floating_base_is_judged_by_its_command(earlier):
    record = EarlierLogs(floating()) if earlier else None
    content = diagnose(floating(deadband=6.0), earlier=record).content
    assert only_cause(content, "valve_deadband")["half_width"]["value"] == pytest.approx(6.0, rel=0.05)
    assert content["gap"]["layer"] == "actuator" and ("reference" in content) == earlier


def test_a_deadband_that_a_force_loop_always_had_is_no_change():
    content = diagnose(floating(deadband=6.0), earlier=EarlierLogs(floating(deadband=6.0, seed=2))).content
    assert content["verdict"] == "no_gap" and content["causes"] == []
