"""What a joint's own search missed, seen with what the others found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import data_of, logs_of, size

from hqpipe.effects.layout import slots
from hqpipe.gap.causes import assemble
from hqpipe.gap.joint_state import JointState
from hqpipe.gap.search import JointSearch
from hqpipe.gap.second_look import look_again
from hqpipe.gap.set_fit import JointFitter

LIBRARY = ("command_delay", "valve_deadband", "orifice_flow", "flow_saturation", "coulomb_friction", "supply_droop")
Z = 3.0


def searches_of(planted, **kwargs):
    logs = logs_of(planted, **({"seconds": 6.0} | kwargs))
    return [JointSearch(JointFitter(data_of(logs, j)), LIBRARY, Z) for j in range(len(planted))]


def state_of(search, *names):
    base, chosen = search.fit(()), search.fit(names)
    return JointState(search, base, chosen, search.with_support(chosen))


def test_a_name_that_stands_in_for_a_bad_start_of_the_others_goes():
    searches = searches_of([size("valve_deadband")] * 3)
    right = [state_of(search, "valve_deadband") for search in searches[:2]]
    last = searches[2]
    both = last.fit(("valve_deadband", "coulomb_friction"))
    stuck = last.fit(("valve_deadband",))
    row = stuck.row.copy()
    row[slots("valve_deadband")[0]] *= 0.1
    last._tried[stuck.effects] = replace(stuck, row=row, loss=4.0 * stuck.loss, heldout=4.0 * stuck.heldout)
    wrong = state_of(last, *both.effects)
    assert {s.effect for s in wrong.support if s.ratio > 2.0} >= {"coulomb_friction"}, "it seems to be needed"
    states = [*right, wrong]
    found = look_again(states, states)
    assert [state.chosen.effects for state in found] == [("valve_deadband",)] * 3
    assert found[2].chosen.loss == pytest.approx(stuck.loss, rel=0.01)


def test_a_name_that_is_needed_stays_wherever_the_others_begin():
    searches = searches_of([size("valve_deadband")] * 2 + [size("valve_deadband", "coulomb_friction")])
    states = [state_of(search, "valve_deadband") for search in searches[:2]]
    states.append(state_of(searches[2], "valve_deadband", "coulomb_friction"))
    assert [s.chosen.effects for s in look_again(states, states)] == [s.chosen.effects for s in states]


def test_a_joint_that_was_given_a_name_is_asked_what_shows_beside_it():
    searches = searches_of([size("command_delay")] * 2 + [size("command_delay", "flow_saturation")])
    alone = [state_of(search, "command_delay") for search in searches[:2]] + [state_of(searches[2])]
    shared = [*alone[:2], state_of(searches[2], "command_delay")]
    assert look_again(alone, shared)[2].chosen.effects == ("command_delay", "flow_saturation")
    assert look_again(shared, shared)[2] is shared[2], "a joint that stands where its own search left it is not asked"


def test_what_belongs_to_the_machine_has_one_size():
    """A joint whose valve loses flow under load, too, bends the sag of the supply, until it has the others'."""
    searches = searches_of([size("supply_droop")] * 4 + [size("supply_droop", "orifice_flow")])
    states = [state_of(search, "supply_droop") for search in searches]
    first = slots("supply_droop")[0]
    own = [state.chosen.row[first] for state in states]
    assert abs(own[4] / np.median(own) - 1.0) > 0.25
    found = look_again(states, states, workers=2)
    assert set(found[4].chosen.effects) == {"orifice_flow", "supply_droop"}
    assert found[4].chosen.row[first] == np.median(own)
    assert [state.chosen for state in found[:4]] == [state.chosen for state in states[:4]]
    droop = next(c for c in assemble(found, np.full(5, 10.0)) if c.effect == "supply_droop")
    assert len(droop.joints) == 5 and droop.parameters["droop"].value == pytest.approx(np.median(own), rel=0.1)


def test_an_earlier_record_is_left_to_its_own_rules():
    (search,) = searches_of([size("valve_deadband")])
    state = state_of(search)
    then = replace(search.fitter.data, then=object())
    beside = replace(state, search=JointSearch(JointFitter(search.fitter.data), LIBRARY, Z))
    beside.search.fitter.data = then
    assert look_again([beside], [beside]) == [beside]
