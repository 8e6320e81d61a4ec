"""Ends of the travel that hold a joint."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.travel_ends import NEAR, Stretch, held_ends

DT, SPEED = 1e-2, 0.5


def to_and_fro(cycles=3, rest=0.5, top=1.0, wander=0.0, scale=1.0):
    """A joint that runs between −1 and `top` and rests at either end, and what pushes it: outward all the while it rests."""
    position, push = [], []
    for i in range(cycles):
        end = top - wander * i
        legs = [(-1.0, end), (end, end), (end, -1.0), (-1.0, -1.0)]
        for start, stop in legs:
            count = round((abs(stop - start) / SPEED or rest) / DT)
            position += np.linspace(start, stop, count).tolist()
            push += [np.sign(stop - start) or np.sign(start)] * count
    return Stretch(scale * np.array(position), np.array(push))


def test_both_ends_hold_a_joint_that_is_pushed_on():
    upper, lower = held_ends([to_and_fro()], DT, SPEED, 0.0)
    assert (upper.upper, lower.upper) == (True, False)
    assert upper.position == pytest.approx(1.0, abs=0.01) and lower.position == pytest.approx(-1.0, abs=0.01)
    assert upper.touched(np.array([0.9, 1.0, 1.1])).tolist() == [False, True, True]
    assert lower.touched(np.array([-0.9, -1.0, -1.1])).tolist() == [False, True, True]


def test_rests_that_nothing_pushes_are_none():
    part = to_and_fro()
    assert held_ends([Stretch(part.position, 0.0 * part.push)], DT, SPEED, 0.0) == []
    assert held_ends([Stretch(part.position, -part.push)], DT, SPEED, 0.0) == []


def test_one_rest_may_have_met_anything():
    assert held_ends([to_and_fro(cycles=1)], DT, SPEED, 0.0) == []
    assert len(held_ends([to_and_fro(cycles=1)] * 2, DT, SPEED, 0.0)) == 2


def test_rests_at_other_places_are_no_end():
    found = held_ends([to_and_fro(wander=5.0 * NEAR)], DT, SPEED, 0.0)
    assert [end.upper for end in found] == [False]


def test_turning_points_are_no_rests():
    assert held_ends([to_and_fro(rest=0.03)], DT, SPEED, 0.0) == []


def test_the_unit_of_the_position_does_not_matter():
    metres, degrees = (held_ends([to_and_fro(scale=s)], DT, s * SPEED, 0.0)[0].position / s for s in (1.0, 57.3))
    assert metres == pytest.approx(degrees)
