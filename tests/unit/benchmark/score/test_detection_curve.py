"""The curve of detection: it finds planted limits, and says why where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hqpipe.benchmark.score.detection_curve import LEAST_CASES, compare, fit_curve

SIZES = np.geomspace(1.0 / 16.0, 2.0, 400)
STEEP = 3.0


def drawn(limit: float, seed: int = 0, sizes: np.ndarray = SIZES, luck: np.ndarray | None = None) -> np.ndarray:
    """Named or not, from a curve that reaches nine in ten at `limit`."""
    luck = np.random.default_rng(seed).random(len(sizes)) if luck is None else luck
    return luck < 1.0 / (1.0 + np.exp(-(STEEP * np.log(sizes / limit) + math.log(9.0))))


def test_planted_curve_is_found():
    curve = fit_curve(SIZES, drawn(0.6))
    assert curve.limit == pytest.approx(0.6, rel=0.2)
    assert curve.slope == pytest.approx(STEEP, rel=0.25)
    assert (curve.reason, curve.cases, curve.named) == ("", 400, int(drawn(0.6).sum()))
    at_limit = 1.0 / (1.0 + math.exp(-curve.slope * math.log(curve.limit / curve.middle)))
    assert at_limit == pytest.approx(0.9)


def test_curve_is_the_likeliest_one():
    named = drawn(0.6)
    curve = fit_curve(SIZES, named)

    def likelihood(slope: float, middle: float) -> float:
        chance = 1.0 / (1.0 + np.exp(-slope * np.log(SIZES / middle)))
        return float(np.log(np.where(named, chance, 1.0 - chance)).sum())

    best = likelihood(curve.slope, curve.middle)
    assert best == pytest.approx(curve.log_likelihood)
    for slope, middle in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.02), (1.0, 0.98)):
        assert likelihood(curve.slope * slope, curve.middle * middle) < best


def test_scale_of_the_sizes_does_not_matter():
    named = drawn(0.6)
    assert fit_curve(1e-4 * SIZES, named).limit == pytest.approx(1e-4 * fit_curve(SIZES, named).limit)


@pytest.mark.parametrize(
    ("named", "reason", "raw"),
    [
        (SIZES > 0.0, "named at every size", 0.0),
        (SIZES < 0.0, "named at no size", math.inf),
        (SIZES > 0.5, "the limit lies between", 0.5),
        (SIZES < 0.5, "larger effects are not named more often", math.nan),
        (drawn(20.0), "the limit lies above 2", None),
        (drawn(0.6) & (np.arange(400) % 3 > 0), "", None),
    ],
)
def test_degenerate_cases_have_no_limit_but_a_reason(named, reason, raw):
    curve = fit_curve(SIZES, named)
    assert curve.limit is None
    assert reason in curve.reason and curve.reason
    if raw is not None:
        assert curve.raw == pytest.approx(raw, rel=0.05, nan_ok=True)


def test_sizes_that_are_never_named_leave_no_limit():
    # A third is missed at any size: the curve crosses nine in ten, the shares do not.
    named = (SIZES > 0.2) & (np.random.default_rng(0).random(400) < 0.8)
    curve = fit_curve(SIZES, named)
    assert curve.slope is not None and curve.limit is None
    assert "only 8" in curve.reason or "only 7" in curve.reason


def test_few_cases_have_no_limit():
    sizes = SIZES[:: 400 // (LEAST_CASES - 1)][: LEAST_CASES - 1]
    assert fit_curve(sizes, sizes > 0.3).reason == f"{LEAST_CASES - 1} cases, at least {LEAST_CASES} are needed"
    assert fit_curve(np.array([]), np.array([], dtype=bool)).limit is None


def test_ratio_of_two_limits_with_its_interval():
    luck = np.random.default_rng(3).random(len(SIZES))
    result = compare(SIZES, drawn(0.8, luck=luck), drawn(0.5, luck=luck))
    assert result.ratio == pytest.approx(1.6, rel=0.15)
    low, high = result.ci95
    assert low < 1.6 < high and low > 1.2
    (first, second) = result.limits95
    assert first[0] < 0.8 < first[1] and second[0] < 0.5 < second[1]


def test_pairing_makes_the_interval_of_equal_methods_a_point():
    named = drawn(0.6)
    result = compare(SIZES, named, named)
    assert (result.ratio, result.ci95) == (1.0, (1.0, 1.0))


def test_interval_covers_about_as_often_as_it_says():
    sizes, covered = SIZES[::4], 0
    for seed in range(12):
        luck = np.random.default_rng(100 + seed).random(len(sizes))
        result = compare(sizes, drawn(0.7, sizes=sizes, luck=luck), drawn(0.5, sizes=sizes, luck=luck))
        low, high = result.ci95
        covered += low <= 1.4 and (high is None or high >= 1.4)
    assert covered >= 10  # 95 % of 12 are 11.4; nine or fewer have a chance of 0.2 %


def test_a_limit_beyond_the_sizes_still_bounds_the_ratio():
    result = compare(SIZES, SIZES < 0.0, drawn(0.5))
    assert result.ratio is None and result.ci95 is None
    assert result.least == pytest.approx(2.0 / fit_curve(SIZES, drawn(0.5)).limit)
    assert result.reason.startswith("diagnosis: named at no size")
    assert compare(SIZES, drawn(0.5), SIZES < 0.0).least is None


def test_same_cases_same_interval():
    sizes = SIZES[::8]
    named, other = drawn(0.7, sizes=sizes), drawn(0.5, seed=1, sizes=sizes)
    assert compare(sizes, named, other) == compare(sizes, named, other)
