"""A cause is confused with what takes over most of what it does."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from hqpipe.identify import stands_for as module
from hqpipe.identify.found import JointCause, JointFound
from hqpipe.identify.stands_for import stands_for, with_what_they_stand_for

ALONE = {"lag": 100.0, "friction": 50.0}


def known(*names):
    return SimpleNamespace(names=frozenset(names))


@pytest.fixture
def told(monkeypatch):
    """Causes → what they stand for, where an effect more leaves the lag `left` of what it does and gains `gain`."""

    def of(left, gain, named=True):
        larger = known("lag", "friction", "delay")
        does = {("lag", 3): left, ("friction", 3): 49.0} | {(name, 2): value for name, value in ALONE.items()}
        search = SimpleNamespace(
            effects={"delay": SimpleNamespace(named=named)},
            gain=lambda one, other: gain,
            screening=SimpleNamespace(does=lambda each, name: does[name, len(each.names)]),
        )
        monkeypatch.setattr(module, "rank_beside", lambda search, known: None)
        monkeypatch.setattr(module, "sets_beside", lambda search, known: [larger])
        return stands_for(search, known("lag", "friction"), frozenset(ALONE))

    return of


def test_a_lag_of_which_a_delay_takes_over_most_may_stand_for_it(told):
    assert told(left=25.0, gain=40.0) == {"lag": ("delay",)}


def test_one_that_keeps_most_of_what_it_does_stands_for_nothing(told):
    assert told(left=60.0, gain=40.0) == {}


def test_what_is_not_probable_is_not_told(told):
    assert told(left=25.0, gain=-1.0) == {}


def test_a_curve_without_meaning_is_no_name(told):
    assert told(left=25.0, gain=40.0, named=False) == {}


def test_it_stands_behind_the_rivals_and_once():
    cause = JointCause("lag", 0.9, (), ("droop", "delay"), (0.1, 0.2))
    joint = JointFound(None, None, None, None, None, (cause,), {}, {}, {}, {})
    (found,) = with_what_they_stand_for([joint], [{"lag": ("delay", "skew")}])
    assert found.causes[0].confused_with == ("droop", "delay", "skew") and found.causes[0].odds == (0.1, 0.2)
