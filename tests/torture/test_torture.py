"""The share of the torture that runs with every test: the same trials each time, two minutes of them."""

from __future__ import annotations

import pytest

from .parts import run_part
from .tally import Tally

SEED = 20
TRIALS = {
    "toy_kills": 14,
    "kills": 1,
    "checkpoints": 1,
    "flips": 12,
    "disks": 6,
    "memory": 1,
    "writers": 3,
    "fuzz": 20,
}


@pytest.mark.parametrize("part", TRIALS)
def test_nothing_is_lost_and_nothing_hangs(part):
    tally = Tally([SEED])
    run_part(part, SEED, tally, lambda done: done < TRIALS[part])
    assert not tally.problems, tally.listing()
    assert tally.unhelpful.total() <= 0.01 * tally.told, tally.table()
