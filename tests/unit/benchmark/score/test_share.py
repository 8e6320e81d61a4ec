"""Intervals of shares."""

from __future__ import annotations

import pytest

from hqpipe.benchmark.score.share import tally, wilson


def test_wilson_interval_is_that_of_the_book():
    # Agresti & Coull, The American Statistician 52, 1998: no success in ten trials gives 0 to 0.2775
    assert wilson(0, 10) == pytest.approx([0.0, 0.2775], abs=1e-4)
    assert wilson(10, 10) == pytest.approx([0.7225, 1.0], abs=1e-4)
    assert wilson(0, 0) == [0.0, 1.0]


def test_a_share_of_nothing_is_none():
    assert tally([]) == {"right": 0, "of": 0, "share": None, "ci95": [0.0, 1.0]}
    assert tally([True, False, True, True])["share"] == 0.75
