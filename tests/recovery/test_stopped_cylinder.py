"""A cylinder in torque mode that rests at its end stops: what it does there is no cause, and hides none."""

from __future__ import annotations

import pytest
from stopped_cylinder_truth import PASSES, STROKE, log_set

from hqpipe.gap.diagnosis import diagnose

WITHOUT = ("gain_drift", "integral_action", "position_dependent_stiffness", "supply_droop", "torque_bias", "backlash")
"""The library is smaller here, which saves minutes; what resembles an impact, a rest or a direction is in it."""


def answer(**kwargs):
    return diagnose(log_set(**kwargs), without=WITHOUT).content


def told(content):
    return [text for text in content["warnings"] if "end stop" in text]


@pytest.mark.parametrize("inside", [True, False])
def test_the_stops_hide_no_cause(inside):
    content = answer(inside=inside)
    assert content["verdict"] == "explained"
    (cause,) = content["causes"]
    assert cause["effect"] == "direction_asymmetry"
    ratio = cause["parameters"]["ratio"]
    assert ratio["value"] == pytest.approx(PASSES, rel=0.02)
    assert ratio["ci95"][0] <= PASSES <= ratio["ci95"][1]
    assert content["gap"]["after"] < 1.15 * content["gap"]["noise_floor"]
    (text,) = told(content)
    assert text.startswith("ram rests on or hits an end stop near ") and " samples (" in text


def test_the_stops_are_no_cause():
    content = answer(ratio=0.0)
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert len(told(content)) == 1


def test_the_stops_cost_the_number_nothing():
    """The same strokes without stops give the same number, as surely to within what fewer windows say."""
    values = []
    for reach in (STROKE, 10.0):
        content = answer(reach=reach)
        (cause,) = content["causes"]
        values.append(cause["parameters"]["ratio"])
        assert bool(told(content)) == (reach == STROKE)
    stopped, free = values
    assert stopped["value"] == pytest.approx(free["value"], rel=0.01)
    widths = [low_high["ci95"][1] - low_high["ci95"][0] for low_high in values]
    assert widths[0] < 2.0 * widths[1]


def test_a_joint_that_hardly_leaves_its_stop_is_left_out():
    content = diagnose(log_set(rests=40.0, seconds=(10.0, 10.0)), window_s=0.2, without=WITHOUT).content
    assert content["verdict"] == "not_identifiable"
    assert [(item["kind"], item["joints"]) for item in content["left_out"]] == [("end_stop", ["ram"])]
    assert content["next_experiment"] == "record longer motion between the end stops"
