"""A joint in the numbers of an earlier record: rows of the loops, shapes, and sizes that both records refer to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from position_loop_logs import changed, neutral, planted_logs, with_column

from hqpipe.identify.model import all_parameters
from hqpipe.layers.actuator import Actuator
from hqpipe.layers.actuator.parameters import BASE_NAMES, LOGGED_SPEED, SPEED_LATE
from hqpipe.machine.layout import NOT_KNOWN, neutral_row, slot
from hqpipe.machine.moment_arm import PARAMETERS as ARM


@pytest.fixture(scope="module")
def livelier():
    """The same machine, moved twice as much, with twice the noise of the torque."""
    return planted_logs({}, {}, seconds=3.0, fit=1, seed=5, motion=2.0, noise=6.0)


def names_of(model):
    return [*BASE_NAMES, *model.places]


@pytest.mark.parametrize("by_opening", [0.0, 1.0])
@pytest.mark.parametrize("absent", [("torque_bias", "nm"), ("direction_asymmetry", "areas")])
def test_numbers_go_into_a_row_and_come_back(model, by_opening, absent):
    rng, parameters = np.random.default_rng(0), all_parameters(model)
    values = neutral(model)
    own = len(model.base) + len(model.places)
    for k, p in enumerate(parameters[:own]):
        size = p.spread if np.isfinite(p.spread) else 0.1 * p.neutral
        size = max(size, 20.0 * p.least)  # an orifice that bends nothing has no areas
        values[k] = np.clip(p.neutral + rng.uniform(0.1, 0.5) * size, p.low, p.high)
    values[names_of(model).index(("supply_droop", "by_opening"))] = by_opening
    values[names_of(model).index(("direction_asymmetry", "areas"))] = 0.1  # smaller ones do not act
    values[names_of(model).index(absent)] = 0.0  # beside an offset of the torque areas do not act
    values[names_of(model).index(("position_dependent_stiffness", "strayed"))] = 0.0  # does not act beside a ratio
    values[BASE_NAMES.index(LOGGED_SPEED)] = values[BASE_NAMES.index(SPEED_LATE)] = 0.0
    found, known = model.values_of(model.row(values))
    np.testing.assert_allclose(found, values, rtol=1e-12)
    assert [BASE_NAMES[k] for k in np.flatnonzero(~known)] == [LOGGED_SPEED, SPEED_LATE, "presliding_rad", *ARM]
    np.testing.assert_allclose(model.error(found), model.error(values), atol=1e-7)


def test_what_a_row_does_not_say_is_as_in_the_new_logs(model):
    """A model of the four coefficients alone."""
    row = np.full_like(neutral_row(), np.nan)
    for owner, name in model.places:
        if name != "by_opening":
            row[slot(owner, name)] = neutral_row()[slot(owner, name)]
    row[[slot("base", k) for k in ("k1", "k2", "k3", "k4")]] = [540.0, 0.05, 21.6, 0.36]
    found, known = model.values_of(row)
    assert found[:4].tolist() == [540.0, 0.05, 21.6, 0.36] and np.isfinite(found).all()
    at = BASE_NAMES.index("presliding_rad")
    assert found[at] == model.base[at].neutral and not known[at]
    np.testing.assert_allclose(found[4:], neutral(model)[4:])


def test_numbers_of_a_row_stay_within_their_bounds(model):
    row = model.row(neutral(model))
    row[slot("base", "k2")] = 1.5
    values, _ = model.values_of(row)
    assert values[1] == model.base[1].high == 1.0


def test_shapes_of_another_record_count_by_their_own_mean_square(logs, livelier):
    then, now = (Actuator(earlier=logs).joints(x).models[0] for x in (logs, livelier))
    values = neutral(now)
    changed, third = len(now.base) + len(now.places), len(values) - len(now.shape_scale) + 2
    values[[changed, third]] = 0.2, 5.0
    found = now.referred_to(values, then)
    assert found[third] == pytest.approx(5.0 * then.shape_scale[2] / now.shape_scale[2])
    np.testing.assert_array_equal(np.delete(found, third), np.delete(values, third))  # a ratio of gains is no torque
    np.testing.assert_allclose(then.referred_to(found, now), values)
    assert values[third] == 5.0, "the numbers that were given are left alone"


def test_both_records_count_numbers_alike(logs, livelier):
    own, beside, then = (
        Actuator(earlier=e).joints(x).models[0] for e, x in [(None, livelier), (logs, livelier), (None, logs)]
    )

    def sizes(model):
        return [(p.name, p.spread, p.low, p.high) for effect in model.effects for p in effect.parameters]

    assert sizes(beside) == sizes(then) != sizes(own)
    middle, clear = slot("setting", "middle"), slot("setting", "clear")
    assert beside.neutral[middle] == then.neutral[middle]
    assert beside.neutral[clear] == own.neutral[clear] != then.neutral[clear], (
        "of the noise of the logs that are judged"
    )
    assert beside.noise[0] == pytest.approx(own.noise[0], rel=0.01), "noise is that of the logs that are judged"
    assert beside.noise[0] > 1.8 * then.noise[0]
    assert beside.neutral[slot("setting", "held")] == NOT_KNOWN


def test_a_joint_that_rested_then_is_counted_by_the_new_logs(logs, livelier):
    still = with_column(logs, "effort", 0, lambda t: np.full(t.samples, 7.0))
    beside, own = (Actuator(earlier=e).joints(livelier).models[0] for e in (still, None))
    assert [p.spread for e in beside.effects for p in e.parameters] == [
        p.spread for e in own.effects for p in e.parameters
    ]


def test_joints_are_matched_by_name(logs, livelier):
    names = logs.joints[::-1]
    turned = replace(changed(logs, lambda t: t.for_joints(names)), joints=names)
    one, two = (Actuator(earlier=e).joints(livelier).models for e in (logs, turned))
    for a, b in zip(one, two, strict=True):
        assert [p.spread for e in a.effects for p in e.parameters] == [
            p.spread for e in b.effects for p in e.parameters
        ]
        assert a.draws == b.draws
