"""A cylinder in torque mode that rests at its end stops: what it does there is no cause, and hides none."""

from __future__ import annotations

import pytest
from stopped_cylinder_truth import PASSES, log_set

from hqpipe.gap.diagnosis import diagnose


def answer(**kwargs):
    return diagnose(log_set(**kwargs)).content


def told(content):
    return [text for text in content["warnings"] if "end stop" in text]


def only_ratio(content):
    """Value and interval of the one cause, unequal flow by direction."""
    (cause,) = content["causes"]
    assert cause["effect"] == "direction_asymmetry"
    ratio = cause["parameters"]["ratio"]
    return ratio["value"], ratio["ci95"]


@pytest.mark.parametrize("inside", [True, False])
def test_the_stops_hide_no_cause(inside):
    content = answer(inside=inside)
    assert content["verdict"] == "explained"
    value, (low, high) = only_ratio(content)
    assert value == pytest.approx(PASSES, rel=0.02) and low <= PASSES <= high
    assert content["gap"]["after"] < 1.2 * content["gap"]["noise_floor"]
    (text,) = told(content)
    assert text.startswith("ram rests on or hits an end stop near ")


def test_the_stops_are_no_cause():
    content = answer(ratio=0.0)
    assert content["verdict"] == "no_gap" and content["causes"] == []
    assert len(told(content)) == 1


def test_the_stops_cost_the_number_nothing():
    """The same strokes without stops give the same number."""
    stopped, free = answer(), answer(reach=10.0)
    assert told(stopped) and not told(free)
    assert only_ratio(stopped)[0] == pytest.approx(only_ratio(free)[0], rel=0.01)
