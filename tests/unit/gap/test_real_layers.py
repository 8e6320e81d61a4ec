"""Real machines whose fault is known, through the layer that their logs are routed to."""

from __future__ import annotations

import pytest
from plant_logs import real

from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.diagnosis import diagnose

for module in ("servo", "joint_motion"):
    pytest.importorskip(f"hqpipe.layers.{module}")


def parameters(content):
    return {cause["effect"]: cause["parameters"] for cause in content["causes"]}


def test_a_servo_without_torque_has_the_friction_that_its_authors_found():
    """Rhoban/bam: friction of the XL330 grows with the torque that is transmitted, next to nothing without load."""
    content = diagnose(real("xl330")).content
    assert content["gap"]["layer"] == "servo" and content["gap"]["unit"] == "rad"
    assert content["causes"][0]["effect"] == "load_dependent_friction" and content["gap"]["shrink"] > 0.4
    assert "coulomb_friction" not in parameters(content)


def test_the_frictions_of_a_positioning_axis_are_those_of_its_authors():
    """EMPS (Janot, Gautier, Brunot 2019): 203.5 N·s/m viscous and 20.39 N dry friction."""
    content = diagnose(real("emps")).content
    assert content["gap"]["layer"] == "joint_motion"
    found = parameters(content)
    assert found["coulomb_friction"]["friction_nm"]["value"] == pytest.approx(20.39, rel=0.02)
    assert found["viscous_friction"]["nm_s_per_rad"]["value"] == pytest.approx(203.5, rel=0.02)


def test_a_ball_screw_has_friction_though_a_curve_over_the_speed_describes_it_as_well():
    content = diagnose(real("cranfield_ref")).content
    assert content["verdict"] == "explained"
    assert parameters(content)["coulomb_friction"]["friction_nm"]["value"] == pytest.approx(0.74, abs=0.05)


def test_the_same_ball_screw_again_has_not_changed():
    content = diagnose(real("cranfield_same"), earlier=EarlierLogs(real("cranfield_ref"))).content
    assert content["gap"]["layer"] == "joint_motion"
    assert content["verdict"] == "no_gap" and content["causes"] == []
