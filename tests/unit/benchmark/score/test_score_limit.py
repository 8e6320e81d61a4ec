"""The limit of detection from judged cases: what counts as named, on which axis, and when the aim is met."""

from __future__ import annotations

import json

import numpy as np
import pytest
from blind_cases import ALL, cause, diagnosis, effect, judged

from hqpipe.benchmark.score.case import Judged
from hqpipe.benchmark.score.limit import MEASURE, limits

EFFECTS = ("backlash", "valve_lag")
COUNT = 120
FACTORS = np.geomspace(1.0 / 16.0, 2.0, COUNT)
LUCK = np.random.default_rng(4).random(COUNT)


def faint(number: int, content: dict | None, known: bool = True) -> Judged:
    name, factor = EFFECTS[number % 2], float(FACTORS[number])
    error = 4.0 * (1.0 + factor**2) ** 0.5  # the effect adds `factor` times the machine's own gap
    gaps = {key: {"all": gap} | dict.fromkeys(ALL, gap) for key, gap in (("with", error), ("all", 4.0))}
    planted = effect(name, size=None, factor=factor)
    return judged("faint", [planted], content, case=f"case_{number:03d}", gaps=gaps if known else None)


def cases(limit: float, **changes) -> list[Judged]:
    """Named by a curve that reaches nine in ten at `limit`."""
    chance = 1.0 / (1.0 + (FACTORS / limit) ** -3.0 / 9.0)
    return [
        faint(i, diagnosis(*([cause(EFFECTS[i % 2], **changes)] if LUCK[i] < chance[i] else []))) for i in range(COUNT)
    ]


def test_limits_and_their_ratio_are_those_that_were_planted():
    found = limits(cases(0.7), cases(0.5))
    row = found["aim"]
    assert row["measure"] == MEASURE and row["of"] == COUNT
    assert row["ratio"] == pytest.approx(1.4, rel=0.2)
    assert row["ci95"][0] < row["ratio"] < row["ci95"][1]
    assert row["limits"] == pytest.approx([0.7, 0.5], rel=0.3)
    assert row["strict"]["ratio"] == row["ratio"]
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.parametrize(("diagnosis_limit", "met"), [(0.5, True), (1.2, False)])
def test_aim_is_met_up_to_one_and_a_half(diagnosis_limit, met):
    assert limits(cases(diagnosis_limit), cases(0.5))["aim"]["met"] is met


def test_axis_of_the_extra_error_is_that_of_the_gaps():
    axes = limits(cases(0.7), cases(0.5))["axes"]
    assert axes["extra"]["ratio"] == pytest.approx(axes["factor"]["ratio"], rel=1e-6)
    nowhere = [faint(i, diagnosis(), known=False) for i in range(COUNT)]
    assert limits(nowhere, nowhere)["axes"]["extra"]["diagnosis"]["cases"] == 0


def test_a_name_in_confused_with_counts_but_not_strictly():
    confused = [
        faint(i, diagnosis(cause("channel_skew", confused_with=[EFFECTS[i % 2]])) if case.causes else diagnosis())
        for i, case in enumerate(cases(0.7))
    ]
    row = limits(confused, cases(0.5))["aim"]
    assert row["ratio"] == limits(cases(0.7), cases(0.5))["aim"]["ratio"]
    assert row["strict"]["ratio"] is None


def test_failed_and_falsely_named_cases_are_not_named():
    lost = [faint(i, None if i % 2 else diagnosis(cause("torque_bias"))) for i in range(COUNT)]
    found = limits(lost, cases(0.5))
    assert found["axes"]["factor"]["diagnosis"]["named"] == 0
    assert found["aim"]["ratio"] is None and "named at no size" in found["aim"]["reason"]
    assert found["aim"]["met"] is False  # the limit lies above all sizes, which are four times the oracle's
    assert (found["false_names"]["right"], found["false_names"]["of"]) == (COUNT // 2, COUNT)


def test_what_nobody_names_is_not_judged():
    silent = [faint(i, diagnosis()) for i in range(COUNT)]
    assert limits(silent, silent)["aim"]["met"] is None
    few = limits(cases(0.7)[:6], cases(0.5)[:6])
    assert few["aim"]["met"] is None and "6 cases, at least" in few["aim"]["reason"]


def test_bins_hold_every_case_once():
    for axis in limits(cases(0.7), cases(0.5))["axes"].values():
        for who in ("diagnosis", "oracle"):
            assert sum(entry[who]["of"] for entry in axis["bins"]) == COUNT
            assert sum(entry[who]["right"] for entry in axis["bins"]) == axis[who]["named"]


def test_rows_by_effect():
    rows = limits(cases(0.7), cases(0.5))["effects"]
    assert [(row["effect"], row["cases"]) for row in rows] == [(name, COUNT // 2) for name in EFFECTS]
    assert all(row["ratio"] == pytest.approx(1.4, rel=0.35) for row in rows)
    (row, _) = limits(cases(0.7)[:8], cases(0.5)[:8])["effects"]
    assert row["limit"] is None and row["reason"][0] == "4 cases, at least 12 are needed"


def test_oracle_must_be_of_the_same_cases():
    with pytest.raises(ValueError, match="not those of the diagnosis"):
        limits(cases(0.7), cases(0.5)[1:])
