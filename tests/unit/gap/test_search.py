"""The search of one joint, on planted data: nothing, one effect, two, and what cannot be told apart."""

from __future__ import annotations

import numpy as np
import pytest
from planted_logs import data_of, logs_of, size

from hqpipe.gap.search import MOST_EFFECTS, WORTH, JointSearch, Support, _against_noise
from hqpipe.gap.set_fit import JointFitter

# A part of the library that holds the planted effects, their look-alikes and some that have nothing to do with them.
LIBRARY = (
    "command_delay",
    "position_bias",
    "valve_lag",
    "valve_deadband",
    "flow_saturation",
    "orifice_flow",
    "coulomb_friction",
    "torque_bias",
)
Z = 3.0
PLANTED = ((), ("valve_deadband",), ("flow_saturation",), ("coulomb_friction",), ("command_delay", "valve_deadband"))


@pytest.fixture(scope="module")
def logs():
    return logs_of([size(*names) for names in PLANTED], seconds=6.0)


@pytest.fixture(scope="module")
def results(logs):
    return [JointSearch(JointFitter(data_of(logs, j)), LIBRARY, Z).run() for j in range(len(PLANTED))]


@pytest.mark.parametrize("j", range(len(PLANTED)))
def test_planted_set_is_found_and_nothing_else(results, j):
    found = results[j]
    assert found.best.effects == PLANTED[j]
    assert set(found.singles) == set(LIBRARY)
    assert found.tried >= 1 + len(LIBRARY) + len(LIBRARY) * (len(LIBRARY) - 1) // 2
    assert [s.effect for s in found.support] == list(PLANTED[j])
    assert all(s.ratio > WORTH and s.z > Z for s in found.support)
    assert found.best.error < 2.2 * 3.0**2


def test_of_a_bias_of_the_torque_and_one_of_the_position_each_is_the_others_rival(results):
    """An offset of the torque is k2/k1 of an offset of the position, in any steady state."""
    logs = logs_of([size("torque_bias"), size("position_bias")], seconds=6.0)
    for j, (name, rival) in enumerate((("torque_bias", "position_bias"), ("position_bias", "torque_bias"))):
        search = JointSearch(JointFitter(data_of(logs, j)), LIBRARY, Z)
        found = search.run()
        assert len(found.best.effects) == 1 and found.best.effects[0] in (name, rival)
        (support,) = found.support
        assert {support.effect, *support.rivals} >= {name}


def test_clear_effects_have_no_rivals(results):
    for j, names in enumerate(PLANTED):
        for support in results[j].support:
            assert support.rivals == (), names


def test_library_without_the_cause_does_not_name_it(logs):
    search = JointSearch(JointFitter(data_of(logs, 1)), ("command_delay", "orifice_flow"), Z)
    assert "valve_deadband" not in search.run().best.effects


@pytest.fixture
def search(logs):
    return JointSearch(JointFitter(data_of(logs, 4)), LIBRARY, Z)


def test_elimination_drops_what_does_not_earn_its_place(search):
    search.fitter.fit(())
    fat = search.fit(("command_delay", "valve_deadband", "coulomb_friction", "flow_saturation"))
    assert search.eliminate(fat).effects == PLANTED[4]
    lean = search.fit(PLANTED[4])
    assert search.eliminate(lean) is lean
    assert len(fat.effects) <= MOST_EFFECTS


def test_gain_is_large_for_a_cause_and_none_for_a_bystander(search):
    both = search.fit(PLANTED[4])
    ratio, z = search.gain(search.without(both, "valve_deadband"), both)
    assert ratio > 10.0 and z > 5.0
    more = search.fit((*PLANTED[4], "torque_bias"), [both])
    ratio, z = search.gain(both, more)
    assert ratio == pytest.approx(1.0, abs=0.02)


def test_gain_knows_that_neighbouring_windows_are_not_independent(search):
    count, rng = 100, np.random.default_rng(0)
    noise = np.repeat(rng.standard_normal((300, count // 5)), 5, axis=1)  # alike over half a second
    own = np.array([search._z(row) for row in noise])
    naive = noise.mean(axis=1) / noise.std(axis=1, ddof=1) * np.sqrt(count)
    assert np.mean(np.abs(own) > 1.96) < 0.12
    assert np.mean(np.abs(naive) > 1.96) > 0.25
    assert search._z(np.ones(3)) == 0.0, "one block has no scatter"


def test_a_few_windows_far_above_the_noise_are_no_accident():
    rng = np.random.default_rng(1)
    left = 16.0 * rng.chisquare(20, 200) / 20
    rare = np.where(np.arange(200) == 70, 900.0, 0.0)
    assert _against_noise(rare, left) > 3.0
    assert _against_noise(-rare, left) < -3.0
    error = 4.0 * rng.standard_normal((2000, 200))
    scatter = (
        2.0 * error * 3.0 * rng.choice([-1.0, 1.0], (2000, 200))
    )  # what predictions that differ by 3 N·m make of noise
    assert np.mean([_against_noise(fall, left) > 2.0 for fall in scatter]) < 0.02


def test_an_effect_that_few_windows_show_is_found():
    """A limit that only the largest jumps reach."""
    logs = logs_of([{"flow_saturation": {"limit": 0.14}}], seconds=8.0)
    data = data_of(logs)
    for signals in (data.fit.signals, data.heldout.signals):
        error = np.abs(signals.command - signals.position)
        assert 1 <= sum(np.any(error[first : first + 100] > 0.14) for first in signals.first) <= 8
    assert JointSearch(JointFitter(data), LIBRARY, Z).run().best.effects == ("flow_saturation",)


def test_a_name_has_to_be_certain_material_worth_it_and_shown_by_the_fit_trials_too(search):
    fit = search.fit(PLANTED[4])

    def earns(ratio, z, shown=30.0, effect="valve_deadband"):
        return search.earns(fit, Support(effect, ratio, z, shown))

    assert earns(30.0, 10.0)
    assert not earns(30.0, Z - 0.1)
    assert not earns(1.05, 10.0)
    assert not earns(1.11, 10.0), "less than 1 % of the torque"
    assert earns(30.0, 10.0, shown=1.5)
    assert not earns(30.0, 10.0, shown=1.3), "what always acts is not seen in the held-out trials alone"
    assert earns(30.0, 10.0, shown=1.0, effect="flow_saturation"), "the fit trials need not have reached a limit"
    assert earns(np.inf, 10.0, shown=1.3), "without it the model runs away"
