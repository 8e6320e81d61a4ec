"""What joints imply is told as far as their numbers, and the other joints of the machine, make it sure."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from hqpipe.identify import implied
from hqpipe.identify.found import JointFound, Number
from hqpipe.identify.implied import Reading, with_implied

NUMBER = Number("stiffness", "N·m/rad", 2.0, (1.0, 4.0))


def joint() -> JointFound:
    model = SimpleNamespace(effects=tuple(range(24)))
    return JointFound(model, None, None, None, None, (), {}, {}, {}, {})


def probabilities(*beyond):
    """Of each joint that reads the effect with so many deviations (None: that reads none); 0 where it is not told."""
    read = [() if z is None else (Reading("soft", NUMBER, z, without="limited"),) for z in beyond]
    found = with_implied([joint() for _ in beyond], read)
    return [sum(cause.probability for cause in each.causes) for each in found]


def test_one_joint_of_a_dozen_has_to_be_far_beyond():
    none = [None] * 11
    assert probabilities(5.0, *none)[0] == 0.0 and probabilities(10.0, *none)[0] > 0.9


def test_most_joints_make_it_likely_in_one_that_is_unsure():
    told = probabilities(*[4.0] * 9, 1.0, None, None)
    assert all(p > 0.99 for p in told[:9]) and 0.5 < told[9] < 0.99 and told[10:] == [0.0, 0.0]


def test_what_is_within_chance_is_told_in_no_joint():
    assert probabilities(*[1.0] * 12) == [0.0] * 12


def test_a_machine_of_one_joint_has_none_to_learn_from():
    assert probabilities(1.5) == [0.0]
    assert probabilities(3.5)[0] > 0.9


def test_the_cause_comes_with_its_number_and_with_what_is_left_without_it():
    (found,) = with_implied([joint()], [(Reading("soft", NUMBER, 6.0, without="limited"),)])
    (cause,) = found.causes
    assert cause.effect == "soft" and cause.numbers == (NUMBER,) and cause.confused_with == ()
    assert found.without == {"soft": "limited"} and found.probabilities == {"soft": pytest.approx(cause.probability)}


def test_a_model_that_implies_nothing_gives_no_reading():
    assert implied.readings(SimpleNamespace(model=object()), None, None) == ()
