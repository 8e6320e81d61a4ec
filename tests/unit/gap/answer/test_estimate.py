"""A number of one joint, and of several that share it."""

from __future__ import annotations

import pytest

from hqpipe.gap.answer.estimate import Estimate, agree, pooled


def parts(*values, deviation=0.1):
    return [Estimate(v, v - 1.96 * deviation, v + 1.96 * deviation, deviation) for v in values]


def test_pooled_value_is_weighted_and_narrower():
    same = pooled(parts(1.0, 1.05, 0.95, 1.0))
    assert same.value == pytest.approx(1.0) and same.deviation == pytest.approx(0.05)
    assert same.high - same.low == pytest.approx(2 * 1.96 * 0.05)
    sharp = Estimate(2.0, 1.98, 2.02, 0.01)
    assert pooled([*parts(1.0), sharp]).value == pytest.approx(2.0, abs=0.02)


def test_joints_that_disagree_widen_the_interval():
    wide, narrow = pooled(parts(0.0, 1.0, 2.0)), pooled(parts(1.0, 1.0, 1.0))
    assert wide.deviation > 5.0 * narrow.deviation
    assert wide.low < 1.0 < wide.high


def test_agreement_is_within_a_quarter_or_within_the_intervals():
    assert agree(parts(1.0, 1.2, 0.8, deviation=1e-3))
    assert not agree(parts(1.0, 1.0, 1.5, deviation=1e-3))
    assert agree(parts(1.0, 1.0, 1.5, deviation=0.5))
    assert not agree(parts(1.0, -1.0, 1.0, deviation=0.1)), "either sign is not one value"
