"""Which names are kept: those that explain more than what stays unexplained beside them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.gap.worth import SLIGHT, drop_outweighed, drop_trifles


class Search:
    """Squared errors by set of effects."""

    def __init__(self, errors):
        self.errors = errors

    def without(self, fit, effect):
        names = tuple(name for name in fit.effects if name != effect)
        return SimpleNamespace(effects=names, error=self.errors[names])

    def fit(self, names, warm):
        return SimpleNamespace(effects=names, error=self.errors[names])

    def with_support(self, fit):
        return ()


def joint(name, errors, chosen, barred=(), scale=1.0):
    from hqpipe.gap.joint_state import JointState

    search = Search(errors)
    search.fitter = SimpleNamespace(data=SimpleNamespace(joint=name, barred=barred, scale=scale))
    base = SimpleNamespace(effects=(), error=errors[()])
    return JointState(search, base, SimpleNamespace(effects=chosen, error=errors[chosen]), ())


class Rest:
    """Joint → share of what is left that can be predicted."""

    def __init__(self, **shares):
        self.shares = shares

    def predictable(self, joint):
        return self.shares[joint]


def cause(effect, *joints):
    return SimpleNamespace(effect=effect, joints=joints)


DELAY, RUB, ORIFICE = "command_delay", "coulomb_friction", "orifice_flow"


@pytest.mark.parametrize(("share", "kept"), [(0.4, (DELAY, RUB)), (0.45, (DELAY,))])
def test_a_name_is_measured_by_what_could_still_be_explained_beside_it(share, kept):
    errors = {(): 500.0, (DELAY,): 60.0, (RUB,): 480.0, (DELAY, RUB): 40.0}
    states, causes = [joint("a", errors, (DELAY, RUB))], [cause(DELAY, "a"), cause(RUB, "a")]
    (state,) = drop_outweighed(states, causes, np.array([1.0]), Rest(a=share))
    assert state.chosen.effects == kept
    assert set(state.dropped) == {DELAY, RUB} - set(kept)


def test_of_two_names_for_one_thing_the_better_stays():
    errors = {
        (): 500.0,
        (DELAY,): 45.0,
        (RUB,): 50.0,
        (DELAY, RUB): 40.0,
    }  # each beside the other falls short of 0.4 · 40
    (state,) = drop_outweighed(
        [joint("a", errors, (DELAY, RUB))], [cause(RUB, "a"), cause(DELAY, "a")], np.array([1.0]), Rest(a=0.4)
    )
    assert state.chosen.effects == (DELAY,)


def test_joints_with_one_cause_are_weighed_together():
    weak = {(): 60.0, (RUB,): 50.0}  # by itself it would go: 10 against 30
    clear = {(): 300.0, (RUB,): 10.0}
    states, rest = [joint("a", weak, (RUB,)), joint("b", clear, (RUB,))], Rest(a=0.5, b=0.5)
    found = drop_outweighed(states, [cause(RUB, "a", "b")], np.array([1.0, 1.0]), rest)
    assert [state.chosen.effects for state in found] == [(RUB,), (RUB,)]
    assert drop_outweighed(states[:1], [cause(RUB, "a")], np.array([1.0]), rest)[0].chosen.effects == ()


def test_what_restored_signs_leave_is_held_against_no_name_of_other_joints():
    clear, bad = {(): 60.0, (RUB,): 10.0}, {(): 410.0, (RUB,): 400.0}
    rest, causes = Rest(a=0.5, b=0.5), [cause(RUB, "a", "b")]
    restored = [joint("a", clear, (RUB,)), joint("b", bad, (RUB,), barred=("backlash",))]
    assert [s.chosen.effects for s in drop_outweighed(restored, causes, np.ones(2), rest)] == [(RUB,), (RUB,)]
    as_logged = [joint("a", clear, (RUB,)), joint("b", bad, (RUB,))]
    assert [s.chosen.effects for s in drop_outweighed(as_logged, causes, np.ones(2), rest)] == [(), ()]
    alone = drop_outweighed(restored[1:], [cause(RUB, "b")], np.ones(1), rest)
    assert alone[0].chosen.effects == (), "nobody else can judge"


def test_what_a_slight_fault_explains_is_held_against_no_name():
    errors = {(): 60.0, (RUB,): 45.0, (RUB, ORIFICE): 30.0}
    unknown = joint("a", errors, (RUB,))
    slight = replace(unknown, dropped={ORIFICE: SLIGHT})
    rest = Rest(a=0.5)  # 22.5 of which the slight one explains 15
    assert drop_outweighed([unknown], [cause(RUB, "a")], np.ones(1), rest)[0].chosen.effects == ()
    assert drop_outweighed([slight], [cause(RUB, "a")], np.ones(1), rest)[0].chosen.effects == (RUB,)


@pytest.mark.parametrize(("bare", "kept"), [(72.0, ()), (74.0, (RUB,))])
def test_a_name_for_most_of_what_is_left_stays_however_predictable_that_is(bare, kept):
    states = [joint("a", {(): bare, (RUB,): 40.0}, (RUB,))]  # 32 or 34 over 39 above the noise
    (state,) = drop_outweighed(states, [cause(RUB, "a")], np.array([1.0]), Rest(a=0.9))
    assert state.chosen.effects == kept


def test_nobody_asks_what_is_predictable_of_noise():
    states = [joint("a", {(): 1.2, (RUB,): 1.0}, (RUB,))]
    assert drop_outweighed(states, [cause(RUB, "a")], np.array([1.0]), Rest())[0].chosen.effects == (RUB,)


@pytest.mark.parametrize(
    ("share", "low", "ratio", "kept"),
    [
        (0.30, 0.25, 1.01, True),
        (0.01, 0.005, 1.01, False),
        (0.30, -0.1, 1.01, False),
        (0.01, 0.005, 1.5, True),
        (-0.04, -0.06, 16.0, True),  # alone it widens the gap, beside the others it closes most of it
        (-0.04, -0.06, 1.01, False),
    ],
)
def test_a_trifle_is_what_neither_the_machine_nor_a_joint_needs(share, low, ratio, kept):
    errors = {(): 500.0, (DELAY,): 60.0, (RUB,): 480.0, (DELAY, RUB): 40.0}
    state = joint("a", errors, (DELAY, RUB))
    support = (SimpleNamespace(effect=DELAY, ratio=2.0, z=9.0), SimpleNamespace(effect=RUB, ratio=ratio, z=9.0))
    state = replace(state, support=support)
    causes = [cause(DELAY, "a"), cause(RUB, "a")]
    (found,) = drop_trifles([state], causes, np.array([0.5, share]), np.array([0.4, low]))
    assert (RUB in found.chosen.effects) is kept
