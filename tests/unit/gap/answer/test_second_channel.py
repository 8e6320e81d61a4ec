"""What pressures settle: a scale of the torque sensor, and whose offset it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken
from planted_logs import logs_of

from hqpipe.gap.answer.layer_causes import LayerCause
from hqpipe.gap.answer.second_channel import CERTAIN, measured, scale_errors, settle_offsets
from hqpipe.gap.checks.cross_check import CrossCheck
from hqpipe.identify.found import JointCause
from hqpipe.machine import EFFECTS

JOINTS = ("LFR", "LFP", "LFK", "RFR", "RFP", "RFK")


def scale(joint, value, half=0.01):
    return CrossCheck("torque_scale", joint, value, "1", value - half, value + half, True, "its kind")


def bias(joint):
    return CrossCheck("torque_bias", joint, 30.0, "N·m", 28.0, 32.0, True, "zero")


def cause(effect, joints, *rivals):
    members = {joint: JointCause(effect, 0.8, (), rivals) for joint in joints}
    return LayerCause(effect, EFFECTS[effect].layer, "joint", members, (), rivals)


def test_joints_with_one_scale_are_one_cause():
    found = scale_errors([scale("LFR", 1.10), scale("LFP", 0.9), scale("LFK", 1.105), bias("LFP")])
    assert [error.joints for error in found] == [("LFR", "LFK"), ("LFP",)]
    ratio = found[0].ratio
    assert ratio.value == pytest.approx(1.1025, abs=1e-3) and ratio.low < ratio.value < ratio.high
    assert ratio.high - ratio.low < 0.02, "two joints know it better than one"
    assert found[1].ratio.low == pytest.approx(0.9 - np.hypot(0.01, 1.96 * 0.0025 * 0.9), abs=1e-5)
    assert scale_errors([]) == []


def test_a_scale_is_a_cause_that_closes_no_part_of_the_gap():
    (error,) = scale_errors([scale("LFR", 1.10), scale("LFK", 1.105)])
    content = error.content(JOINTS)
    assert (content["effect"], content["joints"], content["scope"]) == ("torque_scale", ["LFR", "LFK"], "group")
    assert content["probability"] == CERTAIN and content["layer"] == EFFECTS["torque_scale"].layer
    assert content["shrink"] == 0.0 and content["shrink_ci95"] == [0.0, 0.0] and content["confused_with"] == []
    ratio = content["parameters"]["ratio"]
    assert ratio["unit"] == "1" and ratio["value"] == pytest.approx(error.ratio.value, rel=1e-5)
    assert ratio["ci95"] == pytest.approx([error.ratio.low, error.ratio.high], rel=1e-5)
    (lone,) = scale_errors([scale("LFP", 0.9)])
    assert lone.content(JOINTS)["scope"] == "joint"


def test_confirmed_offset_of_the_sensor_has_no_rival_left():
    (found,) = settle_offsets([cause("torque_bias", ("LFR",), "position_bias", "gain_drift")], [bias("LFR")], True)
    assert found.effect == "torque_bias" and found.rivals == ("gain_drift",)


def test_sound_sensor_leaves_the_null_shift():
    (found,) = settle_offsets([cause("position_bias", ("LFR",), "torque_bias")], [], True)
    assert found.effect == "position_bias" and found.rivals == ()
    (found,) = settle_offsets([cause("position_bias", ("LFR",), "torque_bias")], [], False)
    assert found.rivals == ("torque_bias",), "without pressures nothing is settled"


def test_other_causes_and_mixed_joints_stay_as_they_are():
    before = [cause("valve_lag", ("LFR",), "torque_bias"), cause("torque_bias", ("LFR", "LFP"), "position_bias")]
    assert settle_offsets(before, [bias("LFR")], True) == before


def with_pressures(trajectory, gains):
    """Chambers of 1 cm² at 0.1 m that carry the torque; the sensor of joint j shows `gains[j]` times as much."""
    half = trajectory.effort / (2.0 * 1e-5)
    return replace(trajectory, effort=trajectory.effort * gains, pressure_a=8e6 + half, pressure_b=8e6 - half)


def test_only_certain_findings_of_the_library_count():
    logs = broken(logs_of([{}] * 3, seconds=6.0, joints=("a_knee", "b_knee", "c_knee")), lambda t: t)
    assert measured(logs) == [], "no pressures, no comparison"
    sound = broken(logs, lambda t: with_pressures(t, np.ones(3)))
    assert measured(sound) == []
    scaled = broken(logs, lambda t: with_pressures(t, np.array([1.0, 1.0, 1.1])))
    assert [(c.effect, c.joint) for c in measured(scaled)] == [("torque_scale", "c_knee")]
    assert measured(scaled)[0].value == pytest.approx(1.1, abs=0.01)
    assert measured(scaled, ["torque_scale"]) == []
