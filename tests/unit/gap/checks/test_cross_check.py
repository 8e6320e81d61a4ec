"""Gain, offset and skew of the effort against the chamber pressures."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, plant_logs, real, values, without_pressures

from hqpipe.gap.checks.cross_check import cross_check, kind_of


def significant(logs, **kwargs):
    return [(c.effect, c.joint, c.value) for c in cross_check(logs, **kwargs) if c.significant]


def sensor(joint, **changes):
    return json.dumps({"joints": {joint: {"sensors": changes}}})


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_sound_sensors(source):
    logs = plant_logs((0, 1), source)
    found = cross_check(logs)
    assert len(found) == 3 * len(logs.joints)
    assert [c for c in found if c.significant] == []
    assert all(c.low <= c.value <= c.high for c in found)


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_gain_of_one_sensor(source):
    logs = plant_logs(source=source, changes=sensor("LFK", effort_scale=1.1))
    ((effect, joint, value),) = significant(logs)
    assert (effect, joint) == ("torque_scale", "LFK")
    assert value == pytest.approx(1.1, abs=0.01)


def test_gain_of_the_sensors_of_a_leg():
    """They agree with each other, and are odd beside the rest."""
    changes = json.dumps({"joints": {joint: {"sensors": {"effort_scale": 1.17}} for joint in ("RHR", "RHP", "RHK")}})
    found = significant(plant_logs(changes=changes))
    assert {(effect, joint) for effect, joint, _ in found} == {
        ("torque_scale", joint) for joint in ("RHR", "RHP", "RHK")
    }
    assert [value for *_, value in found] == pytest.approx([1.17] * 3, abs=0.01)


def test_gain_of_all_sensors_needs_the_nominal_one():
    logs = plant_logs(changes='{"sensors": {"effort_scale": 1.1}}')
    assert significant(logs) == []
    t = plant_logs().trials[0].trajectory
    gains = {
        joint: np.polyfit(t.pressure_a[:, j] - t.pressure_b[:, j], t.effort[:, j], 1)[0]
        for j, joint in enumerate(logs.joints)
    }
    found = significant(logs, nominal=gains)
    assert {joint for _, joint, _ in found} == set(logs.joints)
    assert [value for _, _, value in found] == pytest.approx([1.1] * 12, abs=1e-3)


@pytest.mark.parametrize("source", ["pressure", "load_cell"])
def test_offset_of_one_sensor(source):
    logs = plant_logs(source=source, changes=sensor("RFP", effort_bias=15.0))
    ((effect, joint, value),) = significant(logs)
    assert (effect, joint) == ("torque_bias", "RFP")
    assert value == pytest.approx(15.0, abs=1.0)


def test_skew_of_one_sensor_to_a_fraction_of_a_sample():
    logs = plant_logs(changes=sensor("LFK", effort_delay=0.0035))
    ((effect, joint, value),) = significant(logs)
    assert (effect, joint) == ("channel_skew", "LFK")
    assert value == pytest.approx(0.0035, abs=1e-4)


def test_skew_of_load_cells_is_found_to_a_millisecond():
    logs = plant_logs(source="load_cell", changes='{"sensors": {"effort_delay": 0.006}}')
    found = [value for effect, _, value in significant(logs) if effect == "channel_skew"]
    assert len(found) >= 8
    assert found == pytest.approx([0.006] * len(found), abs=1.5e-3)


def test_a_joint_at_rest_tells_no_gain():
    """Friction holds whatever the load asks for: pressures that the effort does not follow then must not pass for a scale."""
    logs = plant_logs(source="load_cell")
    j, resting = logs.joints.index("LFK"), []
    for trial in logs.trials:
        t = trial.trajectory
        still = np.abs(t.velocity[:, j]) < 0.04 * t.velocity[:, j].std()
        assert 0.01 < still.mean() < 0.3
        pressure = t.pressure_a.copy()
        pressure[still, j] *= 1.5
        resting.append(replace(trial, trajectory=replace(t, pressure_a=pressure)))
    moved = replace(logs, trials=tuple(resting))

    def scale(log_set):
        return next(c.value for c in cross_check(log_set) if (c.effect, c.joint) == ("torque_scale", "LFK"))

    assert scale(moved) == pytest.approx(1.0, abs=0.005)
    assert abs(scale(replace(moved, effort_source="pressure")) - 1.0) > 0.02, "where nothing rubs, all rows count"


def test_pistons_of_two_sizes():
    """With unequal pistons the sum of the pressures counts too, and the offset is still that of the sensor."""

    def unequal(t):
        return 0.06 * (1.2e-3 * t.pressure_a - 0.9e-3 * t.pressure_b) + 7.0

    logs = plant_logs()
    changed = broken(logs, lambda t: replace(t, effort=unequal(t)))
    found = [c for c in cross_check(changed) if c.effect == "torque_bias"]
    assert [c.value for c in found] == pytest.approx([7.0] * 12, rel=0.02)


def geared(logs, gains, names=None):
    """The logs with other areas and lever arms, and other names of the joints."""
    changed = broken(logs, lambda t: replace(t, effort=t.effort * gains))
    if names is None:
        return changed
    trials = tuple(replace(one, trajectory=replace(one.trajectory, joints=names)) for one in changed.trials)
    return replace(changed, joints=names, trials=trials)


@pytest.mark.parametrize(
    ("joint", "kind"),
    [
        ("LFK", "K"),
        ("RF_HAA", "haa"),
        ("left_knee", "knee"),
        ("knee_left", "knee"),
        ("leg2_hip", "leg_hip"),
        ("elbow", "elbow"),
        ("a_knee", "knee"),
        ("LF_K", "k"),
    ],
)
def test_the_kind_of_a_joint_is_its_name_without_its_side(joint, kind):
    assert kind_of(joint) == kind


def test_what_all_joints_of_a_kind_have_is_no_scale_of_a_sensor():
    """As of hanging knees, whose friction is large beside what they carry."""
    found = cross_check(geared(plant_logs(), np.tile([1.0, 1.0, 0.965], 4) * np.array([1.0] * 8 + [0.998] + [1.0] * 3)))
    assert not [check for check in found if check.effect == "torque_scale" and check.significant]


def test_joints_of_other_cylinders_are_no_reference():
    """Of two legs neither knee is the odd one, and an ankle of a fourth of the area is no scale of its sensor."""
    designs = np.array([1.0, 1.06, 0.83, 0.22, 0.5, 0.7])
    names = tuple(
        f"{side}_{kind}" for side in ("left", "right") for kind in ("roll", "pitch", "knee", "ankle", "toe", "hip")
    )
    found = cross_check(geared(plant_logs(), np.tile(designs, 2), names))
    assert not [check for check in found if check.effect == "torque_scale" and check.significant]


@pytest.mark.parametrize("style", ["{leg}_{kind}", "{kind}_{leg}"])
def test_a_scale_shows_beside_the_other_legs_joints_of_the_name(style):
    legs, kinds = ("lf", "rf", "lh", "rh"), ("haa", "hfe", "kfe")
    names = tuple(style.format(leg=leg, kind=kind) for leg in legs for kind in kinds)
    designs = np.tile([1.0, 1.3, 0.6], 4)
    designs[5] *= 1.2
    found = cross_check(geared(plant_logs(), designs, names))
    (odd,) = [check for check in found if check.effect == "torque_scale" and check.significant]
    assert odd.joint == names[5] and odd.value == pytest.approx(1.2, abs=0.01)


def test_nothing_without_pressures_or_when_they_say_nothing():
    assert cross_check(broken(plant_logs(), without_pressures)) == []
    assert cross_check(real("emps")) == []
    noise = np.random.default_rng(0).standard_normal((3000, 12))
    assert cross_check(broken(plant_logs(), values("effort", lambda v: noise))) == []
