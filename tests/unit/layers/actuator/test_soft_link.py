"""The travel in which friction turns round tells how stiff the link between piston and joint is."""

from __future__ import annotations

import numpy as np
import pytest
from position_loop_logs import neutral, planted, planted_logs

from hqpipe.identify.identify import identify
from hqpipe.layers.actuator import Actuator, link
from hqpipe.layers.actuator.parameters import BASE_NAMES
from hqpipe.machine.layout import slot

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


def names(found):
    return sorted(cause.effect for cause in found.causes)


def test_a_link_is_named_only_where_it_is_soft(answers):
    free, chain, soft, seal = answers
    assert names(free) == [] and names(chain) == names(seal) == ["coulomb_friction"]
    assert names(soft) == ["coulomb_friction", "transmission_compliance"]


def test_its_stiffness_is_told_with_an_interval_that_holds_the_true_one(answers):
    soft = answers[2]
    (cause,) = (cause for cause in soft.causes if cause.effect == "transmission_compliance")
    (number,) = cause.numbers
    low, high = sorted(soft.model.reported(cause.effect, number.name, end)[1] for end in number.ci95)
    value = soft.model.reported(cause.effect, number.name, number.value)[1]
    assert value == pytest.approx(SOFT, rel=0.15) and low <= SOFT <= high < 2.0 * SOFT


def test_without_the_cause_friction_turns_round_as_behind_a_chain_and_the_error_grows(answers):
    soft = answers[2]
    without = soft.without["transmission_compliance"]
    assert "coulomb_friction" in without.effects and "transmission_compliance" not in without.effects
    assert np.sum(without.error**2) > 1.1 * np.sum(soft.named.error**2)


def test_the_simulator_gets_the_travel_and_no_second_spring(answers):
    soft = answers[2]
    row = soft.model.row(soft.named.values)
    assert row[slot(*link.COMPLIANCE)] == 0.0, "k1 … k4 have the link in them"
    held = row[slot("coulomb_friction", "friction_nm")]
    assert held / row[slot("coulomb_friction", "presliding_rad")] == pytest.approx(SOFT, rel=0.15)


def test_the_travel_of_a_limited_joint_is_that_of_a_chain_at_most():
    model = Actuator().joints(planted_logs({}, seconds=3.0, fit=1)).models[0]
    places = [*BASE_NAMES, *model.places]
    values = neutral(model)
    values[places.index(("coulomb_friction", "friction_nm"))] = FRICTION
    values[places.index("presliding_rad")] = FRICTION / SOFT
    turn, stiffness = slot("coulomb_friction", "presliding_rad"), values[BASE_NAMES.index("k3")] / planted.DT
    assert model.row(values)[turn] == FRICTION / SOFT
    assert model.limited().row(values)[turn] == pytest.approx(link.MOST_BEHIND * FRICTION / stiffness)
    implied = model.implied(values)
    assert implied[places.index(link.COMPLIANCE)] == pytest.approx(1.0 / SOFT)
    assert model.limited().row(implied)[turn] == pytest.approx(FRICTION / SOFT)
    values[places.index("presliding_rad")] = FRICTION / CHAIN
    assert model.implied(values) is None and model.limited().row(values)[turn] == FRICTION / CHAIN
    values[places.index("presliding_rad")] = FRICTION / SEAL
    assert model.implied(values) is None, "more than oil and link give way together"
