"""Shares of the gap by place."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.gap.bootstrap import block_edges, block_weights, interval
from hqpipe.gap.locate import locate, telling
from hqpipe.gap.replay import replay
from hqpipe.gap.tally import tally


@pytest.fixture
def sums(make_logs, right_model):
    def build(**kwargs):
        logs = make_logs(**kwargs)
        return logs, tally([replay(t, right_model(logs), 0.1) for t in logs.heldout])

    return build


def fast_only(error, velocity, time):
    """The second joint loses a third of its gain above 1 rad/s."""
    return error * np.where((np.arange(len(error)) == 1) & (np.abs(velocity) > 1.0), 0.67, 1.0)


def test_shares_of_a_family_sum_to_one(sums):
    logs, found = sums(joints=3, effect=fast_only)
    places = locate(found, np.full(3, 4.2), logs.joints, np.ones(3))
    for family in found.families:
        assert sum(p.share for p in places if p.family == family) == pytest.approx(1.0)
        assert all(p.share_low <= p.share_high for p in places)


def test_squares_are_split_without_loss(sums):
    _, found = sums(joints=2)
    for family in found.families:
        columns = found.family(family)
        assert found.square[:, :, columns].sum(axis=2) == pytest.approx(found.square[:, :, 0])
        assert found.count[:, :, columns].sum(axis=2) == pytest.approx(found.count[:, :, 0])


def test_planted_joint_and_regime_come_first(sums):
    logs, found = sums(joints=3, seconds=10.0, effect=fast_only)
    first = telling(locate(found, np.full(3, 4.2), logs.joints, np.ones(3)))[0]
    assert (first.joint, first.regime) == ("LFP", "high_speed")
    assert first.share_low > 0.5


def test_one_direction_comes_first(sums):
    logs, found = sums(joints=2, effect=lambda e, v, t: e * np.where((np.arange(2) == 0) & (v < 0), 0.9, 1.0))
    first = telling(locate(found, np.full(2, 4.2), logs.joints, np.ones(2)))[0]
    assert (first.joint, first.regime) == ("LFR", "retracting")


def test_late_error_comes_first(sums):
    logs, found = sums(joints=2, effect=lambda e, v, t: e * (0.8 if t > 6.0 else 1.0))
    assert telling(locate(found, np.full(2, 4.2), logs.joints, np.ones(2)))[0].regime == "quarter_4"


def test_time_of_a_passing_cause_is_named_beside_more_telling_places(sums):
    logs, found = sums(joints=3, seconds=10.0, effect=fast_only)
    places = locate(found, np.full(3, 4.2), logs.joints, np.ones(3))
    assert not any(p.regime.startswith("quarter") for p in telling(places))
    added = [p for p in telling(places, ["LFP"]) if p.regime.startswith("quarter")]
    assert len(added) == 1 and added[0].joint == "LFP"
    assert added[0].share == max(p.share for p in places if p.family == "time_span" and p.joint == "LFP")


def test_nothing_above_the_floor_has_no_share(sums):
    logs, found = sums(joints=2)
    assert telling(locate(found, np.full(2, 1e6), logs.joints, np.ones(2))) == []


def test_block_bootstrap_is_wider_than_independent_samples():
    rng = np.random.default_rng(3)
    slow = np.repeat(rng.standard_normal(40), 50)  # 40 independent values, each seen 50 times
    low, high = interval(block_weights(40) @ slow.reshape(40, 50).sum(axis=1) / slow.size)
    assert high - low == pytest.approx(2 * 1.96 * slow.std() / np.sqrt(40), rel=0.15)


def test_blocks_hold_half_a_second_and_the_rest():
    assert block_edges(23, 100, 1e-3).tolist() == [0, 5, 10, 15]
    assert block_edges(2, 100, 1e-3).tolist() == [0]
