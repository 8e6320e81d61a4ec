"""Searches in copies of the process: what they return, and what becomes of errors and of their deaths."""

from __future__ import annotations

import os
import sys

import pytest

from hqpipe.errors import HqpipeError
from hqpipe.identify.joint_pool import JointPool

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere one search runs after the other")


class Counting:
    """Stands for a search; knows in which process it was begun."""

    def __init__(self, number):
        self.number, self.seen = number, []

    def load_compiled_code(self):
        pass

    def first(self):
        self.seen.append(os.getpid())
        return self.number

    def next(self, more):
        self.seen.append(os.getpid())
        return self.number + more, len(self.seen), len(set(self.seen))

    def fails(self):
        raise ValueError(f"joint {self.number}")

    def dies(self):
        os._exit(3)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_each_search_stays_where_it_was_begun(workers):
    done = []
    with JointPool([Counting(k) for k in range(4)], workers) as pool:
        assert pool.each("first", report=done.append) == [0, 1, 2, 3]
        found = pool.each("next", [(10 * k,) for k in range(4)])
        assert pool.some("next", {2: 100, 0: 5}) == {2: (102, 3, 1), 0: (5, 3, 1)}
    assert sorted(done) == [0, 1, 2, 3]
    assert found == [(11 * k, 2, 1) for k in range(4)]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_search_is_that_of_the_pool(workers):
    with pytest.raises(ValueError, match="joint 0"), JointPool([Counting(k) for k in range(2)], workers) as pool:
        pool.each("fails")


def test_the_death_of_a_worker_is_told():
    with pytest.raises(HqpipeError, match="exit code 3"), JointPool([Counting(k) for k in range(2)], 2) as pool:
        pool.each("dies")
