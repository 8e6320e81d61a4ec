"""Which rows of long logs are read."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.sections import LEAST_S, rows_within, sections, shares

DT = 1e-2  # s
LEAST = round(LEAST_S / DT)


def total(found):
    return sum(stop - start for rows in found for start, stop in rows)


def test_sections_of_one_trial_are_evenly_spaced_from_its_start_to_its_end():
    (found,) = sections([(100 * LEAST, DT)], 5 * LEAST)
    starts = np.array([start for start, _ in found])
    assert {stop - start for start, stop in found} == {LEAST}
    assert starts[0] == 0 and found[-1][1] == 100 * LEAST
    assert len(found) == 5 and np.ptp(np.diff(starts)) <= LEAST


def test_sections_stay_in_the_trials_and_apart():
    trials = [(7 * LEAST + 123, DT), (20, DT), (31 * LEAST + 7, 2 * DT)]
    found = sections(trials, 12 * LEAST)
    assert total(found) == pytest.approx(12 * LEAST, rel=0.25)
    for (rows, dt), mine in zip(trials, found, strict=True):
        edges = [edge for pair in mine for edge in pair]
        assert edges == sorted(edges) and all(0 <= edge <= rows for edge in edges)
        assert all((stop - start) * dt >= LEAST_S for start, stop in mine if rows * dt >= LEAST_S)


def test_sections_move_through_trials_that_are_alike():
    found = sections([(6 * LEAST, DT)] * 60, 60 * LEAST)
    places = {start // LEAST for rows in found for start, _ in rows}
    assert places == set(range(6))
    assert sum(bool(rows) for rows in found) > 50


def test_slots_that_touch_are_one_section():
    assert sections([(10 * LEAST, DT)], 10 * LEAST) == [[(0, 10 * LEAST)]]
    (found,) = sections([(10 * LEAST, DT)], 8 * LEAST)
    assert total([found]) == 8 * LEAST and len(found) < 8


def test_short_trials_are_taken_whole_or_not_at_all():
    rows = LEAST // 4
    found = sections([(rows, DT)] * 40, 10 * rows)
    assert [mine for mine in found if mine] == [[(0, rows)]] * 10
    assert found[0] and found[-1]


@pytest.mark.parametrize(
    "fit,heldout,expected",
    [(100, 100, (30, 30)), (100, 10, (50, 10)), (5, 100, (5, 55)), (100, 0, (60, 0)), (20, 20, (20, 20))],
)
def test_each_split_has_half_and_what_the_other_leaves(fit, heldout, expected):
    assert shares(fit, heldout, 60) == expected


def test_columns_of_no_joint_count_where_there_are_many():
    assert rows_within(12_000, 12, 48) == 1000
    assert rows_within(12_000, 1, 0) == 12_000
    assert rows_within(12_000, 1, 64) == 3000
