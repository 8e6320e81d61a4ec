"""What a machine was changed by since an earlier record is found again, with the whole library to choose from."""

from __future__ import annotations

import pytest
from planted_effects import TYPICAL, leaking, logs_of

from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.diagnosis import diagnose
from hqpipe.machine.layout import slot


def size(*names):
    return {name: dict(TYPICAL[name]) for name in names}


@pytest.fixture(scope="module")
def earlier():
    """A machine whose second joint has a deadband."""
    return EarlierLogs(logs_of([{}, size("valve_deadband")]))


def since(earlier, effects, seed=1, **kwargs):
    content = diagnose(logs_of(effects, seed=seed, **kwargs), earlier=earlier).content
    return content, {(cause["effect"], tuple(cause["joints"])): cause["parameters"] for cause in content["causes"]}


def test_nothing_changed(earlier):
    content, causes = since(earlier, [{}, size("valve_deadband")])
    assert content["verdict"] == "no_gap" and causes == {}


def test_leakage_has_grown_in_one_joint(earlier):
    content, causes = since(earlier, [{}, size("valve_deadband")], gains=leaking(1.8, 1.0))
    assert content["verdict"] == "explained" and set(causes) == {("leakage_change", ("LFR",))}
    ratio = causes["leakage_change", ("LFR",)]["ratio"]
    assert ratio["value"] == pytest.approx(1.8, rel=0.1) and ratio["ci95"][0] <= 1.8 <= ratio["ci95"][1]


def test_a_deadband_has_grown_and_a_valve_lags_now(earlier):
    wider = {"valve_deadband": {"half_width": 0.03, "rounding": 0.2}}
    content, causes = since(earlier, [size("valve_lag"), wider])
    assert content["verdict"] == "explained"
    assert set(causes) == {("valve_lag", ("LFR",)), ("valve_deadband", ("LFP",))}
    width = causes["valve_deadband", ("LFP",)]["half_width"]
    assert width["value"] == pytest.approx(0.03, rel=0.05) and width["reference"] == pytest.approx(0.02, rel=0.05)
    lag = causes["valve_lag", ("LFR",)]["time_constant_s"]
    assert lag["value"] == pytest.approx(0.012, rel=0.1) and lag["reference"] is None


def test_what_both_records_have_stays_beside_what_changed():
    """Valves that lagged before and have become worn: beside the wear the lag is no cause, and it is in the model of now."""
    then = {"valve_lag": {"time_constant_s": 0.02}}
    worn = then | {"valve_deadband": {"half_width": 0.05, "rounding": 0.2}}
    found = diagnose(logs_of([worn, then], seed=1), earlier=EarlierLogs(logs_of([then, then])))
    content = found.content
    assert {(cause["effect"], *cause["joints"]) for cause in content["causes"]} == {("valve_deadband", "LFR")}
    assert content["gap"]["after"] < 1.2 * content["gap"]["noise_floor"]
    lag = found.augmented.parameters[:, slot("valve_lag", "time_constant_s")]
    assert lag == pytest.approx([0.02, 0.02], rel=0.1)
