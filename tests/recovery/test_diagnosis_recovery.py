"""Small machines with planted effects, diagnosed from end to end with the whole library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_effects import TYPICAL, logs_of

from hqpipe.gap.diagnosis import diagnose
from hqpipe.logs.joint_kinds import PRISMATIC

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


def test_the_chambers_of_a_short_slide_are_found_like_those_of_a_joint_that_turns():
    """The same machine with cylinders that act on a slide instead of a lever of 5 cm."""
    turning, lever = logs_of([size("position_dependent_stiffness")] * 2, seconds=SECONDS), 0.05

    def slid(trial):
        t = trial.trajectory
        motion = {name: lever * getattr(t, name) for name in ("position", "velocity", "position_command")}
        return replace(trial, trajectory=replace(t, effort=t.effort / lever, **motion))

    kinds = dict.fromkeys(turning.joints, PRISMATIC)
    content = diagnose(replace(turning, trials=tuple(map(slid, turning.trials)), kinds=kinds)).content
    assert named(content) == {("position_dependent_stiffness", turning.joints)}
    assert content["causes"][0]["parameters"]["slope_per_rad"]["unit"] == "1/m"
    assert parameter(content, "position_dependent_stiffness", "slope_per_rad") == pytest.approx(1.5 / lever, rel=0.05)
    assert parameter(content, "position_dependent_stiffness", "length_rad") == pytest.approx(0.45 * lever, rel=0.05)


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


@pytest.mark.parametrize(("flow", "by_opening"), [((1.0, 0.0), 0.0), ((0.0, 2.0), 1.0)])
def test_a_sagging_supply_is_felt_by_speeds_or_by_openings(flow, by_opening):
    logs = logs_of([size("supply_droop")] * 3, seconds=SECONDS, flow=flow)
    content = diagnose(logs).content
    assert named(content) == {("supply_droop", logs.joints)} and content["verdict"] == "explained"
    assert parameter(content, "supply_droop", "by_opening") == pytest.approx(by_opening, abs=0.05)
    assert parameter(content, "supply_droop", "recovery_s") == pytest.approx(0.15, rel=0.2)


def test_a_limit_that_only_large_jumps_reach_is_found():
    logs = logs_of([{"flow_saturation": {"limit": 0.14}}, {}], seconds=8.0)
    for trial in logs.fit:
        error = np.abs(trial.trajectory.position_command - trial.trajectory.position)[:, 0]
        assert np.mean([part.max() > 0.14 for part in np.split(error, 80)]) < 0.3
    content = diagnose(logs).content
    assert named(content) == {("flow_saturation", logs.joints[:1])}
    assert parameter(content, "flow_saturation", "limit") == pytest.approx(0.14, rel=0.01)


def test_a_limit_that_the_fit_trials_hardly_reach_is_unknown_with_the_reason():
    """Four of 80 windows to fit, and a held-out trial that it spoils."""
    content = diagnose(logs_of([{"flow_saturation": {"limit": 0.14}}], seconds=8.0)).content
    assert content["verdict"] == "unknown" and content["causes"] == []
    assert any("No fit has seen them" in text for text in content["warnings"])


@pytest.mark.parametrize(("stall", "causes"), [(900.0, {("orifice_flow", ("LFR",))}), (20000.0, set())])
def test_a_load_that_every_valve_feels_is_no_fault(stall, causes):
    logs = logs_of([{"orifice_flow": {"effort_max_nm": stall}}, {}], seconds=SECONDS, noise=0.1)
    assert named(diagnose(logs).content) == causes
