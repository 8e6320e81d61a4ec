"""The seeds that compare trains with."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from hqpipe.stages.compare import Params
from hqpipe.stages.comparison.seeds import training_seeds


@pytest.mark.parametrize(
    ("given", "seeds"),
    [(1, [7]), (3, [7, 8, 9]), ("0:3", [0, 1, 2]), ("5:6", [5]), ("4294967295:4294967296", [4294967295])],
)
def test_a_number_counts_from_the_stages_seed_and_a_range_says_all(given, seeds):
    assert training_seeds(Params(seeds=given).seeds, 7) == seeds


def test_numbers_go_on_at_nought_behind_the_largest_seed():
    assert training_seeds(2, 2**32 - 1) == [2**32 - 1, 0]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (0, "expected 1 to 1000 trainings .* got 0"),
        (-1, "got -1"),
        (1001, "got 1001"),
        (True, "expected a number of trainings, or a range of seeds A:B .* got 'True'"),
        (2.0, "got '2.0'"),
        (None, "got nothing"),
        ("", "got nothing"),
        ("3", "expected a number of trainings, or a range"),
        ("a:b", "got 'a:b'"),
        ("1:2:3", "got '1:2:3'"),
        ("-1:2", "expected seeds from 0 to 4294967295, got -1:2"),
        ("4294967295:4294967297", "expected seeds from 0 to"),
        ("3:3", "expected 1 to 1000 seeds .* got 0 with 3:3"),
        ("5:2", "got 0 with 5:2"),
        ("0:1001", "got 1001 with 0:1001"),
    ],
)
def test_what_is_no_seeds_is_refused(given, text):
    with pytest.raises(ValidationError, match=text):
        Params(seeds=given)
