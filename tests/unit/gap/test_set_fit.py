"""A set of effects fitted to one joint, from several starts."""

from __future__ import annotations

import numpy as np
import pytest
from planted_logs import data_of, logs_of, size

from hqpipe.effects.layout import BASE, neutral_row, slot, slots
from hqpipe.gap.set_fit import JointFitter, in_order, is_poor, window_errors

LIMIT = 0.12  # rad: a fit that begins with the tightest limit ends in a false minimum


@pytest.fixture(scope="module")
def logs():
    both = size("command_delay", "valve_deadband")
    return logs_of([{}, size("valve_deadband"), {"flow_saturation": {"limit": LIMIT}}, both], seconds=4.0)


def test_sets_are_in_the_order_of_the_chain():
    assert in_order(["torque_bias", "valve_lag", "command_delay", "valve_lag"]) == (
        "command_delay",
        "valve_lag",
        "torque_bias",
    )


def test_base_fit_recovers_the_gains(logs):
    fit = JointFitter(data_of(logs, 0)).fit()
    gains = {name: fit.row[slot("base", name)] for name in BASE}
    assert gains["k1"] == pytest.approx(540.0, rel=0.02)
    assert gains["k2"] == pytest.approx(0.05, rel=0.05)
    assert gains["k3"] == pytest.approx(21.6, rel=0.02)
    assert fit.error == pytest.approx(np.mean(fit.heldout)) and fit.error < 2.2 * 3.0**2
    assert fit.effects == () and len(fit.free) == 4


def test_multi_start_finds_a_limit_that_is_inactive_at_first(logs):
    """At a limit wider than any command the slope is zero: one wide start would stay there."""
    fitter = JointFitter(data_of(logs, 2))
    fit = fitter.fit(("flow_saturation",))
    assert 1.0 / fit.row[slot("flow_saturation", "limit")] == pytest.approx(LIMIT, rel=0.05)
    assert fit.error < 2.2 * 3.0**2 < 0.02 * fitter.fit().error
    wide = fitter.fit().row.copy()
    wide[slot("flow_saturation", "limit")] = 0.01 / fitter.data.size["command"]
    stuck, *_ = fitter._run(("flow_saturation",), wide, 25)
    assert stuck[slot("flow_saturation", "limit")] == wide[slot("flow_saturation", "limit")]


def test_single_and_pair_recover_their_numbers(logs):
    fit = JointFitter(data_of(logs, 1)).fit(("valve_deadband",))
    assert fit.row[slot("valve_deadband", "half_width")] == pytest.approx(0.02, rel=0.05)
    pair = JointFitter(data_of(logs, 3)).fit(("command_delay", "valve_deadband"))
    assert pair.row[slot("valve_deadband", "half_width")] == pytest.approx(0.02, rel=0.05)
    assert pair.row[slot("command_delay", "delay_s")] == pytest.approx(0.0064, rel=0.05)
    assert pair.error < 2.2 * 3.0**2


def test_a_set_is_fitted_once_and_its_numbers_are_its_own(logs):
    fitter = JointFitter(data_of(logs, 1))
    fit = fitter.fit(("valve_deadband", "command_delay"))
    assert fitter.fit(("command_delay", "valve_deadband")) is fit
    np.testing.assert_array_equal(fit.heldout, window_errors(fit.row, fitter.data.heldout))
    np.testing.assert_array_equal(fit.fitted, window_errors(fit.row, fitter.data.fit))
    free = {slot("base", name) for name in ("k1", "k2", "k3", "k4")}
    free |= {*slots("command_delay"), *slots("valve_deadband")}
    assert set(fit.free) == free and fit.hessian.shape == (7, 7)


def test_warm_start_drops_what_is_not_in_the_set_and_adds_what_is(logs):
    fitter = JointFitter(data_of(logs, 3))
    pair = fitter.fit(("command_delay", "valve_deadband"))
    fewer = fitter.fit(("command_delay",), [pair])
    neutral = neutral_row()
    np.testing.assert_array_equal(fewer.row[slots("valve_deadband")], neutral[slots("valve_deadband")])
    more = fitter.fit(("command_delay", "valve_deadband", "valve_lag"), [pair])
    assert more.loss <= pair.loss * 1.0001
    assert fewer.loss > 2.0 * pair.loss


def test_a_set_that_is_worse_than_a_part_of_it_is_fitted_again(logs):
    fitter, both = JointFitter(data_of(logs, 3)), ("command_delay", "valve_deadband")
    part = fitter.fit(("valve_deadband",))
    astray = fitter.fit().row.copy()
    astray[slots("command_delay")[0]], astray[slots("valve_deadband")[0]] = 0.08, 0.15
    fitter._known[both] = fitter._result(both, *fitter._run(both, astray, 1))
    assert is_poor(fitter.fit(both), part)
    assert not is_poor(part, fitter.fit(both)), "not a part of it"
    found = fitter.fit(both, [part])
    assert found is fitter.fit(both)
    assert found.row[slots("command_delay")[0]] == pytest.approx(0.0064, rel=0.05)
    assert found.error < 2.2 * 3.0**2


def test_uneven_friction_gives_way_to_an_offset():
    sizes = size("coulomb_friction", "torque_bias")
    sizes["coulomb_friction"]["asymmetry_nm"] = 0.0
    fitter = JointFitter(data_of(logs_of([sizes], seconds=6.0)))
    column = slot("coulomb_friction", "asymmetry_nm")
    alone, both = fitter.fit(("coulomb_friction",)), fitter.fit(("coulomb_friction", "torque_bias"))
    assert column in alone.free and abs(alone.row[column]) > 5.0
    assert column not in both.free and both.row[column] == 0.0
    assert both.row[slot("torque_bias", "nm")] == pytest.approx(30.0, rel=0.05)
