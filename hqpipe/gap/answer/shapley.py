"""How far each cause shrinks the gap: Shapley shares over the found set, with block-bootstrap intervals.

The value of a subset of causes is the fall of the held-out RMSE when exactly they are modelled and all other
coefficients are fitted again; that of a part of the causes is at least 0, for without the others a prediction may overflow,
which says nothing of how much they close. A cause's share is its mean contribution over all orders in which the causes could
be added (Shapley, 1953), so shares add up to the whole fall whatever the causes have in common.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import factorial

import numpy as np

from hqpipe.gap.residuals.bootstrap import block_weights, interval

MOST_EXACT = 6  # causes; 64 subsets
ORDERS = 40  # sampled orders beyond that
SEED = 0
OVERFLOWED = 1e200  # squared error that stands for an infinite one, so that blocks without weight add nothing


@dataclass(frozen=True, eq=False)
class Shrink:
    """Fall of the RMSE as a share of the RMSE before: per cause and as a whole, with 95 % intervals."""

    each: np.ndarray
    each_ci95: np.ndarray
    whole: float
    whole_ci95: tuple[float, float]


def shapley(count: int, errors: Callable[[frozenset[int]], np.ndarray]) -> Shrink:
    """Shares of `count` causes.

    Args:
        count: number of causes.
        errors: subset of causes → (blocks,) summed squared held-out error of the machine.
    """
    cache: dict[frozenset[int], np.ndarray] = {}

    def value(subset: frozenset[int]) -> np.ndarray:
        if subset not in cache:
            cache[subset] = np.minimum(errors(subset), OVERFLOWED)
        return cache[subset]

    everything = frozenset(range(count))
    blocks = len(value(frozenset()))
    weights = np.vstack([np.ones((1, blocks)), block_weights(blocks)])

    def fall(subset: frozenset[int]) -> np.ndarray:
        before = np.sqrt(weights @ value(frozenset()))
        shrunk = 1.0 - np.sqrt(weights @ value(subset)) / np.maximum(before, 1e-300)
        shrunk = np.where(before > 0.0, shrunk, 0.0)  # nothing shrinks where there is no error
        return shrunk if subset == everything else np.maximum(shrunk, 0.0)

    each = _exact(count, fall) if count <= MOST_EXACT else _sampled(count, fall)
    each = each.reshape(count, len(weights))
    whole = fall(everything)
    low, high = interval(each[:, 1:].T)
    whole_low, whole_high = interval(whole[1:])
    return Shrink(each[:, 0], np.stack([low, high], axis=1), float(whole[0]), (float(whole_low), float(whole_high)))


def _exact(count: int, fall: Callable[[frozenset[int]], np.ndarray]) -> np.ndarray:
    """(count, draws) from all subsets."""
    rows = []
    for player in range(count):
        others = [i for i in range(count) if i != player]
        total = 0.0
        for size in range(count):
            weight = factorial(size) * factorial(count - size - 1) / factorial(count)
            for chosen in combinations(others, size):
                total = total + weight * (fall(frozenset((*chosen, player))) - fall(frozenset(chosen)))
        rows.append(total)
    return np.array(rows)


def _sampled(count: int, fall: Callable[[frozenset[int]], np.ndarray]) -> np.ndarray:
    """(count, draws) from sampled orders and their reverses."""
    rng = np.random.default_rng(SEED)
    orders = [rng.permutation(count) for _ in range(ORDERS // 2)]
    rows = None
    for order in [*orders, *(order[::-1] for order in orders)]:
        last = fall(frozenset())
        rows = np.zeros((count, len(last))) if rows is None else rows
        for i, player in enumerate(order):
            now = fall(frozenset(int(p) for p in order[: i + 1]))
            rows[player] += (now - last) / ORDERS
            last = now
    return rows
