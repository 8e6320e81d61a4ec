"""Small machines with planted effects, diagnosed from end to end with the whole library."""

from __future__ import annotations

import pytest
from planted_effects import TYPICAL, logs_of

from hqpipe.gap.diagnosis import diagnose

SECONDS = 6.0


def size(*names):
    return {name: dict(TYPICAL[name]) for name in names}


def named(content):
    return {(cause["effect"], tuple(cause["joints"])) for cause in content["causes"]}


def parameter(content, effect, name):
    (cause,) = [c for c in content["causes"] if c["effect"] == effect]
    return cause["parameters"][name]["value"]


def test_two_effects_in_one_leg_of_which_one_is_everywhere():
    logs = logs_of([size("command_delay", "valve_deadband"), size("command_delay")], seconds=SECONDS)
    content = diagnose(logs).content
    assert content["verdict"] == "explained"
    assert named(content) == {("command_delay", logs.joints), ("valve_deadband", logs.joints[:1])}
    assert parameter(content, "command_delay", "delay_s") == pytest.approx(0.0064, rel=0.05)
    assert parameter(content, "valve_deadband", "half_width") == pytest.approx(0.02, rel=0.05)
    scopes = {cause["effect"]: cause["scope"] for cause in content["causes"]}
    assert scopes == {"command_delay": "machine", "valve_deadband": "joint"}
    assert sum(cause["shrink"] for cause in content["causes"]) == pytest.approx(content["gap"]["shrink"], abs=0.01)


def test_friction_and_valve_limit_in_different_joints():
    logs = logs_of([size("coulomb_friction"), size("flow_saturation"), {}], seconds=SECONDS)
    content = diagnose(logs).content
    assert content["verdict"] == "explained"
    assert named(content) == {("coulomb_friction", logs.joints[:1]), ("flow_saturation", logs.joints[1:2])}
    assert parameter(content, "coulomb_friction", "friction_nm") == pytest.approx(25.0, rel=0.1)
    assert parameter(content, "flow_saturation", "limit") == pytest.approx(0.06, rel=0.05)


def test_sagging_supply_is_a_cause_of_the_machine():
    logs = logs_of([size("supply_droop")] * 3, seconds=SECONDS)
    content = diagnose(logs).content
    assert named(content) == {("supply_droop", logs.joints)}
    assert content["causes"][0]["scope"] == "machine"
    assert parameter(content, "supply_droop", "droop") == pytest.approx(0.1, rel=0.1)


def test_sound_machine():
    content = diagnose(logs_of([{}, {}], seconds=SECONDS, seed=4)).content
    assert content["verdict"] == "no_gap" and content["causes"] == []


@pytest.mark.parametrize("effect", ["valve_lag", "orifice_flow", "direction_asymmetry"])
def test_single_effect_is_the_only_cause(effect):
    logs = logs_of([size(effect), {}], seconds=SECONDS, seed=5)
    content = diagnose(logs).content
    assert content["verdict"] == "explained"
    assert named(content) == {(effect, logs.joints[:1])}
    assert content["causes"][0]["confused_with"] == []
