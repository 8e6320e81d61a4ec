"""Which names are kept: those that explain more than what stays unexplained beside them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from hqpipe.gap.worth import drop_outweighed


class Search:
    """Squared errors by set of effects."""

    def __init__(self, errors):
        self.errors = errors

    def without(self, fit, effect):
        names = tuple(name for name in fit.effects if name != effect)
        return SimpleNamespace(effects=names, error=self.errors[names])

    def with_support(self, fit):
        return ()


def joint(name, errors, chosen):
    from hqpipe.gap.joint_state import JointState

    search = Search(errors)
    search.fitter = SimpleNamespace(data=SimpleNamespace(joint=name))
    base = SimpleNamespace(effects=(), error=errors[()])
    return JointState(search, base, SimpleNamespace(effects=chosen, error=errors[chosen]), ())


def cause(effect, *joints):
    return SimpleNamespace(effect=effect, joints=joints)


DELAY, RUB = "command_delay", "coulomb_friction"


@pytest.mark.parametrize(("rest", "kept"), [(2.0, (DELAY, RUB)), (40.0, (DELAY,))])
def test_a_name_is_measured_by_what_stays_open_beside_it(rest, kept):
    errors = {(): 500.0, (DELAY,): rest + 20.0, (RUB,): 480.0, (DELAY, RUB): rest}
    states = drop_outweighed([joint("a", errors, (DELAY, RUB))], [cause(DELAY, "a"), cause(RUB, "a")], np.array([1.0]))
    assert states[0].chosen.effects == kept
    assert set(states[0].dropped) == {DELAY, RUB} - set(kept)


def test_joints_with_one_cause_are_weighed_together():
    weak = {(): 60.0, (RUB,): 50.0}  # by itself it would go: 10 of 49
    clear = {(): 300.0, (RUB,): 10.0}
    states = [joint("a", weak, (RUB,)), joint("b", clear, (RUB,))]
    found = drop_outweighed(states, [cause(RUB, "a", "b")], np.array([1.0, 1.0]))
    assert [state.chosen.effects for state in found] == [(RUB,), (RUB,)]
    assert drop_outweighed(states[:1], [cause(RUB, "a")], np.array([1.0]))[0].chosen.effects == ()


def test_nothing_left_above_the_noise_outweighs_nothing():
    states = [joint("a", {(): 1.2, (RUB,): 1.0}, (RUB,))]
    assert drop_outweighed(states, [cause(RUB, "a")], np.array([1.0]))[0].chosen.effects == (RUB,)
