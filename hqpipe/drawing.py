"""Sharing out kinds of cases and drawing what they are about; what the cases hold is not known here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hqpipe.errors import UsageError, near_match


def apportion(shares: Mapping[str, float], n: int, rng: np.random.Generator) -> list[str]:
    """`n` names in these shares (largest remainders), shuffled."""
    exact = np.array(list(shares.values())) * n
    counts = np.floor(exact).astype(int)
    for index in np.argsort(counts - exact, kind="stable")[: n - counts.sum()]:
        counts[index] += 1
    return [str(name) for name in rng.permutation(np.repeat(list(shares), counts))]


def endless(items: Sequence[Any], rng: np.random.Generator) -> Iterator[Any]:
    """All items in random order, then all in another, and so on."""
    while True:
        for index in rng.permutation(len(items)):
            yield items[index]


def shares_of(kinds: Sequence[str], usual: Mapping[str, float], on_request: Mapping[str, float]) -> dict[str, float]:
    """Share of each kind of case that is asked for.

    Args:
        kinds: names; none for all of `usual`. usual, on_request: kind → weight.

    Raises:
        UsageError: a kind that does not exist.
    """
    known = {**usual, **on_request}
    for kind in kinds:
        if kind not in known:
            what = f"--kind {kind[:80]}{near_match(kind[:80], known)}: no such kind of case (known: {', '.join(known)})"
            raise UsageError(what, field="--kind", fix="name one of these")
    if not kinds:
        return dict(usual)
    total = sum(known[kind] for kind in set(kinds))
    return {kind: weight / total for kind, weight in known.items() if kind in kinds}
