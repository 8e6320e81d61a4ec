"""Shares of the gap by place."""

from __future__ import annotations

import numpy as np
import pytest
from tallies import JOINTS, tally

from hqpipe.gap.residuals.bootstrap import block_weights, interval
from hqpipe.gap.residuals.locate import locate, telling

FLOOR, ALIKE = np.full(3, 4.2), np.ones(3)
FAST = ("speed", "high_speed")


def test_shares_of_a_family_sum_to_one():
    found = tally(1, FAST, 300.0)
    places = locate(found, FLOOR, JOINTS, ALIKE)
    for family in found.families:
        assert sum(p.share for p in places if p.family == family) == pytest.approx(1.0)
        assert all(p.share_low <= p.share_high for p in places)


@pytest.mark.parametrize(
    ("joint", "regime"),
    [(1, FAST), (0, ("direction", "retracting")), (2, ("time_span", "quarter_4"))],
)
def test_planted_joint_and_regime_come_first(joint, regime):
    first = telling(locate(tally(joint, regime, 300.0), FLOOR, JOINTS, ALIKE))[0]
    assert (first.joint, first.family, first.regime) == (JOINTS[joint], *regime)
    assert first.share_low > 0.5


def test_time_of_a_passing_cause_is_named_beside_more_telling_places():
    places = locate(tally(1, FAST, 300.0), FLOOR, JOINTS, ALIKE)
    assert not any(p.regime.startswith("quarter") for p in telling(places))
    added = [p for p in telling(places, ["LFP"]) if p.regime.startswith("quarter")]
    assert len(added) == 1 and added[0].joint == "LFP"
    assert added[0].share == max(p.share for p in places if p.family == "time_span" and p.joint == "LFP")


def test_nothing_above_the_floor_has_no_share():
    assert telling(locate(tally(), np.full(3, 1e6), JOINTS, ALIKE)) == []


def test_block_bootstrap_is_wider_than_independent_samples():
    rng = np.random.default_rng(3)
    slow = np.repeat(rng.standard_normal(40), 50)  # 40 independent values, each seen 50 times
    low, high = interval(block_weights(40) @ slow.reshape(40, 50).sum(axis=1) / slow.size)
    assert high - low == pytest.approx(2 * 1.96 * slow.std() / np.sqrt(40), rel=0.15)
