"""Shapley shares: their axioms, and all orders by brute force."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from hqpipe.gap.answer.shapley import shapley

BLOCKS = 24


def game(count, seed=0, null=(), alike=()):
    """Squared errors by block that fall with every cause, with interactions; null causes do nothing."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.05, 0.4, count)
    size[list(null)] = 0.0
    for a, b in alike:
        size[b] = size[a]
    scatter = rng.uniform(0.5, 1.5, BLOCKS)

    def errors(subset):
        left = np.prod([1.0 - size[i] for i in subset])
        both = 0.1 if {0, 1} <= subset and not {0, 1} & set(null) else 0.0
        return 100.0 * scatter * (left - both)

    return errors


def fall(errors, subset):
    return 1.0 - np.sqrt(errors(subset).sum() / errors(frozenset()).sum())


@pytest.mark.parametrize("count", [1, 2, 4])
def test_shares_are_the_mean_contribution_over_all_orders(count):
    errors = game(count)
    expected = np.zeros(count)
    orders = list(permutations(range(count)))
    for order in orders:
        for i, player in enumerate(order):
            expected[player] += fall(errors, frozenset(order[: i + 1])) - fall(errors, frozenset(order[:i]))
    np.testing.assert_allclose(shapley(count, errors).each, expected / len(orders), atol=1e-12)


@pytest.mark.parametrize("count", [3, 6, 8])
def test_shares_add_up_to_the_whole(count):
    errors = game(count)
    found = shapley(count, errors)
    assert found.whole == pytest.approx(fall(errors, frozenset(range(count))))
    assert found.each.sum() == pytest.approx(found.whole)


@pytest.mark.parametrize("count", [4, 8])
def test_a_cause_that_changes_nothing_gets_nothing(count):
    found = shapley(count, game(count, null=(2,)))
    assert found.each[2] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found.each_ci95[2], 0.0, atol=1e-12)
    assert (np.delete(found.each, 2) > 0.01).all()


def test_causes_that_do_alike_get_alike():
    found = shapley(4, game(4, alike=((0, 1), (2, 3))))
    assert found.each[0] == pytest.approx(found.each[1])
    assert found.each[2] == pytest.approx(found.each[3])
    assert found.each[0] != pytest.approx(found.each[2], rel=0.01)


def test_sampled_orders_come_near_the_exact_shares():
    errors = game(7, seed=3)
    exact = np.zeros(7)
    others = lambda i: [k for k in range(7) if k != i]  # noqa: E731
    from itertools import combinations
    from math import factorial

    for player in range(7):
        for size in range(7):
            weight = factorial(size) * factorial(6 - size) / factorial(7)
            for chosen in combinations(others(player), size):
                exact[player] += weight * (fall(errors, frozenset((*chosen, player))) - fall(errors, frozenset(chosen)))
    np.testing.assert_allclose(shapley(7, errors).each, exact, atol=0.01)


def test_intervals_hold_the_value_and_widen_with_the_scatter_of_blocks():
    rng = np.random.default_rng(1)

    def errors(scatter):
        before, after = (100.0 * np.exp(scatter * rng.standard_normal(BLOCKS)) for _ in range(2))
        return lambda subset: 0.5 * after if subset else before

    calm, wild = shapley(1, errors(0.1)), shapley(1, errors(0.8))
    for found in (calm, wild):
        assert found.each_ci95[0, 0] <= found.each[0] <= found.each_ci95[0, 1]
        assert found.whole_ci95 == pytest.approx(tuple(found.each_ci95[0]))
    assert np.diff(wild.each_ci95[0]) > 3.0 * np.diff(calm.each_ci95[0])


def test_every_subset_is_fitted_once():
    seen = []
    errors = game(5)
    shapley(5, lambda subset: seen.append(subset) or errors(subset))
    assert len(seen) == len(set(seen)) == 2**5


def test_nothing_shrinks_where_there_is_no_error():
    found = shapley(1, lambda subset: np.zeros(BLOCKS))
    assert found.whole == 0.0 and found.whole_ci95 == (0.0, 0.0) and np.all(found.each == 0.0)


@pytest.mark.parametrize("count", [3, 8])
def test_without_a_cause_that_keeps_the_prediction_finite_the_others_close_nothing(count):
    errors = game(count)

    def overflowing(subset):
        return np.full(BLOCKS, np.inf) if subset and 0 not in subset else errors(subset)

    found = shapley(count, overflowing)
    assert found.whole == pytest.approx(fall(errors, frozenset(range(count))))
    assert found.each.sum() == pytest.approx(found.whole)
    assert (found.each > 0.0).all() and found.each[0] == found.each.max() <= found.whole
    assert np.isfinite(found.each_ci95).all()
