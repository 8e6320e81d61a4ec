"""Which effects may stand in the place of a machine's causes, and how probable that is."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from hqpipe.identify.exchanges import LEAST_ODDS, rivals_of
from hqpipe.identify.found import JointCause
from hqpipe.identify.joint_moves import Step


def joint(*causes):
    """(effect, rivals, odds) of each cause."""
    return SimpleNamespace(causes=tuple(JointCause(name, 0.9, (), rivals, odds) for name, rivals, odds in causes))


def test_a_rival_that_half_of_the_joints_list_is_one_in_all_of_them():
    listing, other = joint(("delay", ("lag",), (0.4,))), joint(("delay", (), ()))
    (rival,) = rivals_of([listing, other])
    assert rival.step == Step("delay", "lag") and rival.joints == (0, 1) and rival.odds == 0.4
    assert rivals_of([listing, other, other]) == []


def test_joints_without_the_cause_have_no_part_in_it():
    (rival,) = rivals_of([joint(), joint(("delay", ("lag",), (0.4,))), joint(("friction", (), ()))])
    assert rival.joints == (1,)


def test_the_odds_are_those_of_the_middle_joint():
    answers = [joint(("delay", ("lag",), (odds,))) for odds in (0.1, 0.3, 50.0)]
    assert rivals_of(answers)[0].odds == 0.3


@pytest.mark.parametrize("odds,weighed", [(1e-30, LEAST_ODDS), (1e304, 1.0 / LEAST_ODDS)])
def test_neither_a_rival_nor_the_cause_is_ruled_out(odds, weighed):
    assert rivals_of([joint(("delay", ("lag",), (odds,)))])[0].odds == weighed


def test_what_no_log_could_tell_apart_is_as_likely():
    assert rivals_of([joint(("bias", ("areas",), ()))])[0].odds == 1.0
