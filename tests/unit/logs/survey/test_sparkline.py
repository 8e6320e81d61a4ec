from __future__ import annotations

import numpy as np

from hqpipe.logs.survey.sparkline import ASCII, BLOCKS, levels_for, sparkline


def test_a_ramp_rises_through_all_levels():
    assert sparkline(np.linspace(0, 1, 800), 0, 1, 8) == BLOCKS
    assert sparkline(np.linspace(1, 0, 800), 0, 1, 8, ASCII) == ASCII[::-1]


def test_short_constant_and_missing_signals():
    assert sparkline(np.array([0.0, 1.0]), 0, 1, 10) == BLOCKS[0] + BLOCKS[-1]
    assert sparkline(np.full(50, 3.0), 3, 3, 4) == BLOCKS[4] * 4
    assert sparkline(np.array([0.0, np.nan, 1.0]), 0, 1, 3) == f"{BLOCKS[0]} {BLOCKS[-1]}"


def test_blocks_only_where_the_encoding_has_them():
    assert [levels_for(e) for e in ("utf-8", "cp437", "ascii", "latin-1", None, "nonsense")] == [BLOCKS, *[ASCII] * 5]
