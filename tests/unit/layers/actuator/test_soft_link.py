"""The travel in which friction turns round tells how stiff the link between piston and joint is."""

from __future__ import annotations

import numpy as np
import pytest
from position_loop_logs import neutral, planted, planted_logs

from hqpipe.identify.identify import identify
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.parameters import BASE_NAMES
from hqpipe.machine.layout import slot
from hqpipe.machine.viscous_friction import MOST_BEHIND

FRICTION = 25.0  # N·m
STIFFNESS = planted.GAINS["k3"] / planted.DT  # N·m/rad, of oil and link in series
SOFT, CHAIN, SEAL = (
    2.0 * STIFFNESS,
    8.0 * STIFFNESS,
    0.5 * STIFFNESS,
)  # the last gives way more than oil and link together


@pytest.fixture(scope="module")
def answers():
    """Joints without friction, behind a chain, behind a soft link, and with seals that give way themselves."""
    effects = [
        {"coulomb_friction": {"friction_nm": FRICTION, "presliding_rad": FRICTION / k}} for k in (CHAIN, SOFT, SEAL)
    ]
    return identify(Actuator().joints(planted_logs({}, *effects, seconds=8.0)), workers=2).found


@pytest.fixture(scope="module")
def model():
    return Actuator().joints(planted_logs({}, seconds=3.0, fit=1)).models[0]


def rubbing(model, stiffness):
    """Values of a joint with friction in front of a link."""
    values, places = neutral(model), [*BASE_NAMES, *model.places]
    values[places.index(("coulomb_friction", "friction_nm"))] = FRICTION
    values[places.index("presliding_rad")] = FRICTION / stiffness
    return values


def names(found):
    return [cause.effect for cause in found.causes]


def test_a_link_is_named_only_where_it_is_soft(answers):
    free, chain, soft, seal = answers
    assert names(free) == [] and names(chain) == names(seal) == ["coulomb_friction"]
    assert names(soft) == ["coulomb_friction", "transmission_compliance"]


def test_its_stiffness_is_told_with_an_interval_that_holds_the_true_one(answers):
    soft = answers[2]
    cause = soft.causes[1]
    (number,) = cause.numbers
    value, *ends = (soft.model.reported(cause.effect, number.name, x)[1] for x in (number.value, *number.ci95))
    assert value == pytest.approx(SOFT, rel=0.15) and min(ends) < SOFT < max(ends) < 2.0 * SOFT


def test_without_the_cause_friction_turns_round_as_behind_a_chain(answers):
    soft = answers[2]
    without = soft.without["transmission_compliance"]
    assert without.effects == soft.named.effects == ("coulomb_friction",)
    row = soft.model.limited().row(without.values)
    turn, held = (row[slot("coulomb_friction", name)] for name in ("presliding_rad", "friction_nm"))
    assert turn <= 1.001 * MOST_BEHIND * held / (row[slot("base", "k3")] / planted.DT)
    assert np.sum(without.heldout**2) > 1.1 * np.sum(soft.named.heldout**2)


def test_the_simulator_gets_the_travel_and_no_second_spring(answers):
    soft = answers[2]
    row = soft.model.row(soft.named.values)
    assert row[slot("transmission_compliance", "stiffness_nm_per_rad")] == 0.0, "k1 … k4 have the link in them"
    turn, held = (row[slot("coulomb_friction", name)] for name in ("presliding_rad", "friction_nm"))
    assert held / turn == pytest.approx(SOFT, rel=0.15)


def test_what_a_joint_implies_follows_from_friction_and_travel(model):
    assert model.implied(neutral(model)) == (), "no friction says nothing"
    (told,) = model.implied(rubbing(model, SOFT))
    stiffness = rubbing(model, SOFT)[BASE_NAMES.index("k3")] / planted.DT
    assert told.value == pytest.approx(1.0 / SOFT)
    assert told.beyond == pytest.approx(np.log(stiffness / SOFT / MOST_BEHIND))
    (of_chain,), (of_seal,) = (model.implied(rubbing(model, k)) for k in (CHAIN, SEAL))
    assert of_chain.beyond < 0.0 < told.beyond < told.most < of_seal.beyond


def test_a_joint_implies_nothing_that_is_left_out(model):
    logs = planted_logs({}, seconds=3.0, fit=1)
    (without,) = Actuator().joints(logs, without=["transmission_compliance"]).models
    assert model.implies == ("transmission_compliance",) and without.implies == ()
    assert without.implied(rubbing(without, SOFT)) == ()


def test_the_travel_of_a_limited_joint_is_that_of_a_chain_at_most(model):
    turn = slot("coulomb_friction", "presliding_rad")
    values = rubbing(model, SOFT)
    stiffness = values[BASE_NAMES.index("k3")] / planted.DT
    assert model.row(values)[turn] == FRICTION / SOFT
    assert model.limited().row(values)[turn] == pytest.approx(MOST_BEHIND * FRICTION / stiffness)
    assert model.limited().row(rubbing(model, CHAIN))[turn] == FRICTION / CHAIN
