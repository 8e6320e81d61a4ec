"""Changes of coefficients: which column leads, and their ratios."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.effects.layout import neutral_row, slot
from hqpipe.gap.changes import CANDIDATES, CHANGES, FACTORS, columns, in_order, leaders, multiplied, ratios
from hqpipe.report.diagnosis_advice import ADVICE, MEANINGS

THEN = {"k1": 540.0, "k2": 0.05, "k3": 21.6, "k4": 0.36}


def row(**base):
    p = neutral_row()
    for name, value in (THEN | base).items():
        p[slot("base", name)] = value
    return p


@pytest.mark.parametrize(
    "changed",
    [
        {"leakage_change": 1.8},
        {"stiffness_change": 0.7},
        {"gain_change": 0.8, "stiffness_change": 1.3},
        {"velocity_coupling_change": 1.2, "stiffness_change": 0.6},
        {"torque_scale": 1.1, "stiffness_change": 0.9},
        {"gain_change": 0.5, "leakage_change": 3.0, "torque_scale": 1.1, "stiffness_change": 0.9},
    ],
)
def test_what_was_multiplied_comes_back(changed):
    then, now = row(), row()
    for name, factor in changed.items():
        now = multiplied(now, name, factor)
    assert ratios(now, then, list(changed)) == pytest.approx(changed)
    lead = leaders(list(changed), then)
    assert len(set(lead.values())) == len(changed), "each has a column of its own"
    assert all(column in [slot("base", k) for k in FACTORS[name]] for name, column in lead.items())


def test_more_changes_than_coefficients_leave_one_without_a_number():
    single = [name for name, group in FACTORS.items() if len(group) == 1]
    assert set(leaders([*single, "stiffness_change"], row())) == set(single)


def test_a_coefficient_that_was_nothing_leads_nothing():
    assert leaders(["leakage_change"], row(k2=0.0)) == {}
    assert ratios(row(k2=0.0), row(k2=0.0), ["leakage_change"]) == {}
    assert ratios(multiplied(row(k2=0.0), "stiffness_change", 0.8), row(k2=0.0), ["stiffness_change"]) == pytest.approx(
        {"stiffness_change": 0.8}
    )


def test_names_are_known_in_one_order_and_told_to_people():
    assert in_order(["valve_lag", "gain_change", "command_delay", "valve_lag"]) == (
        "gain_change",
        "command_delay",
        "valve_lag",
    )
    assert set(CHANGES) <= set(CANDIDATES) and set(CHANGES) <= set(MEANINGS) and set(CHANGES) <= set(ADVICE)
    assert columns("leakage_change") == [slot("base", "k2")]
    np.testing.assert_array_equal(multiplied(row(), "gain_change", 1.0), row())
