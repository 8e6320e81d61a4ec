"""Of sets that explain a joint alike it has the one that more of the machine has."""

from __future__ import annotations

from dataclasses import replace

import pytest
from planted_logs import data_of, logs_of, size

from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import JointSearch
from hqpipe.gap.set_fit import JointFitter
from hqpipe.gap.sharing import seek_consensus

LIBRARY = ("valve_lag", "valve_deadband", "direction_asymmetry", "coulomb_friction", "viscous_friction")
Z = 3.0


def states_of(planted, chosen, barred=(), joints=()):
    """One joint per row: what is planted in it, and the names that its search is said to have ended with."""
    logs = logs_of([size(*names) if isinstance(names, tuple) else names for names in planted], seconds=6.0)
    states = []
    for j, names in enumerate(chosen):
        data = replace(data_of(logs, j), barred=("backlash",) if j in barred else ())
        data = replace(data, joint=joints[j]) if joints else data
        search = JointSearch(JointFitter(data), LIBRARY, Z)
        fit = search.fit(names)
        states.append(JointState(search, search.fit(()), fit, search.with_support(fit)))
    return states


def names_of(states):
    return [set(state.chosen.effects) for state in states]


def test_a_joint_that_has_more_than_a_set_has_it_too():
    """The right pair stands by itself in one joint only, the name that imitates it in two."""
    pair, wrong = ("valve_deadband", "viscous_friction"), ("coulomb_friction",)
    more = [(*pair, "direction_asymmetry"), (*pair, "valve_lag")]
    states = states_of([pair, pair, pair, *more], [wrong, wrong, pair, *more])
    assert names_of(seek_consensus(states)) == [set(pair)] * 3 + [set(names) for names in more]


@pytest.mark.parametrize("barred", [False, True])
def test_a_small_name_that_only_one_joint_has_is_the_sign_that_was_restored(barred):
    slight = size("direction_asymmetry") | {"coulomb_friction": {"friction_nm": 3.5, "asymmetry_nm": 0.0}}
    lone = ("direction_asymmetry", "coulomb_friction")
    states = states_of(
        [("direction_asymmetry",)] * 3 + [slight], [("direction_asymmetry",)] * 3 + [lone], {3} if barred else ()
    )
    (support,) = [s for s in states[3].support if s.effect == "coulomb_friction"]
    assert 1.1 < support.ratio < 1.5 and support.z > Z, "worth a name in a joint whose torque came with its sign"
    assert names_of(seek_consensus(states))[3] == set(lone if not barred else lone[:1])


def test_a_name_that_most_joints_have_stays_where_the_sign_was_restored():
    both = ("direction_asymmetry", "coulomb_friction")
    states = states_of(
        [("direction_asymmetry",), both, both, both], [("direction_asymmetry",), both, both, both], {1, 2, 3}
    )
    assert names_of(seek_consensus(states)) == names_of(states)


def test_a_name_that_a_kind_of_joints_has_stays_where_its_sign_was_restored():
    slight = size("direction_asymmetry") | {"coulomb_friction": {"friction_nm": 3.5, "asymmetry_nm": 0.0}}
    one, both = ("direction_asymmetry",), ("direction_asymmetry", "coulomb_friction")
    joints = ("LFK", "RFK", "LHK", "LFP", "RFP", "LHP", "RHP")
    states = states_of([slight] * 3 + [one] * 4, [both] * 3 + [one] * 4, {0, 1, 2}, joints)
    assert names_of(seek_consensus(states)) == names_of(states)
