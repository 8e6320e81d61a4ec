"""What a controller does over the seeds of its trainings: means, and 95 % intervals from two seeds on.

A training is one draw: its walks share a policy, and so do not tell how much policies of other seeds differ. So the walks of a
seed are taken together first, and the interval is Student's over the seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hqpipe.stages.comparison.results import MEASURES

FALLS, REWARD = "falls", "reward"
Row = Mapping[str, Any]
Values = Mapping[int, float | None]


def over_seeds(values: Values) -> dict[str, Any] | None:
    """mean, ci95 and seeds.

    Args:
        values: seed → value; seeds without one do not count.

    Returns:
        The mean, the ends of its interval and the number of seeds; None where there is no value. There is no interval for a
        single seed, and none for seeds that are all alike, as where none ever fell: neither says how far others may be off.
    """
    from hqpipe.identify.uncertainty import student

    known = [value for value in values.values() if value is not None]
    if not known:
        return None
    count, mean = len(known), sum(known) / len(known)
    if len(set(known)) == 1:
        return {"mean": mean, "ci95": None, "seeds": count}
    variance = sum((value - mean) ** 2 for value in known) / (count - 1)
    half = float(student(count - 1.0)) * (variance / count) ** 0.5
    return {"mean": mean, "ci95": [mean - half, mean + half], "seeds": count}


def measures(rows: Sequence[Row]) -> dict[str, Any]:
    """Measure, and `FALLS`, → `over_seeds` of what the policies of one controller did.

    Args:
        rows: of `walks`, of the policies. A measure of a seed is its mean over the walks that did not fall, `FALLS` the share
            of those that did.
    """
    return _pooled(
        {seed: [(row,) for row in own] for seed, own in _by_seed(rows).items()}, lambda walk, of: of(walk[0])
    )


def differences(rows: Sequence[Row], others: Sequence[Row]) -> dict[str, Any]:
    """The same of the differences of `rows` from `others`, walk by walk: same training seed, scenario and seed of the walk.

    Measures are compared over the pairs in which neither fell, falls over all.
    """
    known = {_walk(row): row for row in others}
    paired = [(row, known[_walk(row)]) for row in rows if _walk(row) in known]
    seeds: dict[int, list[tuple[Row, ...]]] = {}
    for pair in paired:
        seeds.setdefault(pair[0]["training_seed"], []).append(pair)
    return _pooled(seeds, lambda pair, of: _difference(*(of(row) for row in pair)))


def _pooled(
    seeds: Mapping[int, Sequence[tuple[Row, ...]]], value: Callable[[tuple[Row, ...], Callable], float | None]
) -> dict[str, Any]:
    """value: of a walk, or a pair of walks, for what is read of each."""
    found = {
        FALLS: over_seeds(
            {s: _mean([value(w, lambda row: float(row["fell"])) for w in own]) for s, own in seeds.items()}
        )
    }
    for name in MEASURES:
        upright = {seed: [w for w in own if not any(row["fell"] for row in w)] for seed, own in seeds.items()}
        of = {
            seed: _mean([value(w, lambda row, name=name: row.get(name)) for w in own]) for seed, own in upright.items()
        }
        found[name] = over_seeds(of)
    return found


def _by_seed(rows: Sequence[Row]) -> dict[int, list[Row]]:
    found: dict[int, list[Row]] = {}
    for row in rows:
        found.setdefault(row["training_seed"], []).append(row)
    return found


def _walk(row: Row) -> tuple[Any, ...]:
    return row["training_seed"], row["scenario"], row["walk_seed"]


def _difference(one: float | None, other: float | None) -> float | None:
    return None if one is None or other is None else one - other


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
