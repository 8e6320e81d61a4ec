"""The rates behind the four coefficients, and what a change of one of them does to a sample."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.layers.actuator.changes import MULTIPLIES, RATIOS, multiply_rates
from hqpipe.machine import EFFECTS
from hqpipe.report.diagnosis_advice import OTHERS

THEN = np.array([540.0, 0.05, 21.6, 0.36, 7.0])  # k1 … k4, and a number that is no coefficient
NAMES = ("k1", "k2", "k3", "k4")


def changed(*changes, then=THEN):
    values = then.copy()
    for name, ratio in changes:
        RATIOS[name].multiply(values, ratio)
    return values


def rates(values):
    """a1, x, a3, a4 of the coefficients, by the formulas of the page on the diagnosis."""
    decay = -np.log(1.0 - values[1])
    a1, a3, a4 = values[[0, 2, 3]] * decay / values[1]
    return np.array([a1, decay, a3, a4])


@pytest.mark.parametrize("ratio", [0.3, 1.8, 5.0])
def test_more_leakage_takes_more_within_the_sample(ratio):
    """An exact sample of τ' = a − x τ: a part of what comes in leaks away before the sample ends."""
    now = changed(("leakage_change", ratio))
    decay = -np.log(1.0 - THEN[1])
    assert now[1] == pytest.approx(1.0 - np.exp(-ratio * decay))
    kept = [(1.0 - np.exp(-x)) / x for x in (decay, ratio * decay)]
    np.testing.assert_allclose(now[[0, 2, 3]] / THEN[[0, 2, 3]], kept[1] / kept[0])
    assert (now[[0, 2, 3]] < THEN[[0, 2, 3]]).all() == (ratio > 1.0)


@pytest.mark.parametrize("name", MULTIPLIES)
def test_the_rates_of_a_change_are_multiplied_and_no_others(name):
    then, now = rates(THEN), rates(changed((name, 1.7)))
    np.testing.assert_allclose(now / then, [1.7 if k in MULTIPLIES[name] else 1.0 for k in NAMES])
    assert changed((name, 1.7))[4] == THEN[4]
    assert RATIOS[name].names == MULTIPLIES[name]


def test_changes_compose_in_any_order():
    changes = [("leakage_change", 3.0), ("stiffness_change", 0.9), ("torque_scale", 1.1), ("gain_change", 0.5)]
    now = changed(*changes)
    np.testing.assert_allclose(changed(*changes[::-1]), now)
    np.testing.assert_allclose(rates(now) / rates(THEN), [0.5 * 1.1 * 0.9, 3.0 * 0.9, 1.1 * 0.9, 0.9])
    np.testing.assert_allclose(changed(*changes, *((name, 1.0 / ratio) for name, ratio in changes)), THEN)


@pytest.mark.parametrize("name", MULTIPLIES)
def test_a_ratio_of_one_changes_nothing(name):
    np.testing.assert_allclose(changed((name, 1.0)), THEN, rtol=1e-14)


def test_where_nothing_leaks_nothing_leaks_more():
    tight = np.array([540.0, 0.0, 21.6, 0.36])
    np.testing.assert_array_equal(changed(("leakage_change", 1.8), then=tight), tight)
    np.testing.assert_allclose(changed(("stiffness_change", 2.0), then=tight), 2.0 * tight)


def test_a_torque_that_leaks_away_within_a_sample_stays_a_number():
    values = np.array([540.0, 1.0, 21.6, 0.36])
    for ratio in (0.05, 20.0):
        now = values.copy()
        multiply_rates(("k2",), now, ratio)
        assert np.isfinite(now).all() and 0.0 < now[1] <= 1.0 and (now > 0.0).all()


def test_every_change_is_an_effect_that_people_are_told_of():
    assert set(MULTIPLIES) <= {*EFFECTS, *OTHERS}
    assert "torque_scale" in EFFECTS
