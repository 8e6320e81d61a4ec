"""Means and Student's intervals over the seeds of trainings, and paired differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from hqpipe.report.controller_table import spread_text
from hqpipe.stages.comparison.intervals import differences, measures, over_seeds
from hqpipe.stages.comparison.results import MEASURES


def row(training: int, walk: int, value: float | None, *, fell: bool = False, scenario: str = "forward_10") -> dict:
    head = {"training_seed": training, "walk_seed": walk, "scenario": scenario, "fell": fell}
    return {**head, **dict.fromkeys(MEASURES, value), "torque_rmse": None}


def test_the_interval_is_students():
    values = [1.0, 2.0, 4.0]
    found = over_seeds(dict(enumerate(values)))
    expected = stats.t.interval(0.95, 2, np.mean(values), stats.sem(values))
    assert found["seeds"] == 3 and found["mean"] == pytest.approx(7.0 / 3.0)
    assert found["ci95"] == pytest.approx(expected)


def test_one_seed_has_no_interval_and_none_no_mean():
    assert over_seeds({3: 2.0, 4: None}) == {"mean": 2.0, "ci95": None, "seeds": 1}
    assert over_seeds({3: None}) is None and over_seeds({}) is None


def test_seeds_that_are_all_alike_have_no_interval():
    assert over_seeds({1: 0.0, 2: 0.0, 3: 0.0}) == {"mean": 0.0, "ci95": None, "seeds": 3}


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(2000):
        low, high = over_seeds(dict(enumerate(rng.normal(1.0, 0.3, 3))))["ci95"]
        held += low <= 1.0 <= high
    assert 0.93 < held / 2000 < 0.97


def test_walks_of_one_training_count_as_one_draw():
    found = measures([row(1, walk, 1.0) for walk in range(50)] + [row(2, 0, 3.0)])
    assert found["drift"]["mean"] == 2.0 and found["drift"]["seeds"] == 2
    assert found["drift"] == over_seeds({1: 1.0, 2: 3.0})


def test_walks_that_fell_count_as_falls_alone():
    found = measures([row(1, 0, 1.0), row(1, 1, 9.0, fell=True), row(2, 0, 9.0, fell=True), row(2, 1, 9.0, fell=True)])
    assert found["drift"] == {"mean": 1.0, "ci95": None, "seeds": 1}
    assert found["falls"]["mean"] == 0.75 and found["falls"]["seeds"] == 2
    assert found["torque_rmse"] is None


def test_differences_are_of_the_same_training_seed_and_walk():
    others = [row(1, 0, 5.0), row(1, 1, 100.0), row(2, 0, 50.0), row(3, 0, 7.0), row(1, 0, 40.0, scenario="stand")]
    rows = [row(2, 0, 48.0), row(1, 1, 96.0), row(1, 0, 4.0), row(4, 0, 7.0), row(1, 2, 0.0)]
    found = differences(rows, others)
    assert found["drift"] == over_seeds({1: -2.5, 2: -2.0})
    assert found["falls"]["mean"] == 0.0 and found["torque_rmse"] is None


def test_measures_are_compared_where_neither_fell_and_falls_everywhere():
    others = [row(1, 0, 5.0), row(1, 1, 9.0, fell=True), row(1, 2, 6.0), row(1, 3, 1.0, fell=True)]
    rows = [row(1, 0, 4.0), row(1, 1, 1.0), row(1, 2, 9.0, fell=True), row(1, 3, 1.0)]
    found = differences(rows, others)
    assert found["drift"]["mean"] == -1.0
    assert found["falls"]["mean"] == -0.25


def test_differences_of_pairs_are_surer_than_differences_of_means():
    rng = np.random.default_rng(0)
    level, gain = rng.normal(10.0, 3.0, 4), rng.normal(-1.0, 0.1, 4)  # seeds differ more than controllers do
    others, rows = [[row(seed, 0, level[seed] + shift * gain[seed]) for seed in range(4)] for shift in (0.0, 1.0)]
    low, high = differences(rows, others)["drift"]["ci95"]
    assert low < -1.0 < high < 0.0
    (a, b), (c, d) = (measures(each)["drift"]["ci95"] for each in (others, rows))
    assert a < d and c < b


def test_a_table_shows_an_interval_only_where_there_is_one():
    assert spread_text(over_seeds({1: 0.5}), 100.0) == "50"
    assert spread_text({"mean": 0.5, "ci95": [0.4, 0.6], "seeds": 2}, 100.0) == "50 ± 10"
    assert spread_text(None) == "–"
