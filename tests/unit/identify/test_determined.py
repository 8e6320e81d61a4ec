"""Which parameters rest on a single window of the logs."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.determined import single_window

BOTH = np.ones(2, bool)
APART, TOGETHER = np.eye(2), np.ones((2, 2))  # information of a window that tells both, or their sum only


def told(*parts: np.ndarray) -> np.ndarray:
    return single_window(np.array(parts), BOTH)


@pytest.mark.parametrize(("share", "decided"), [(0.85, False), (0.95, True)])
def test_a_share_of_the_information(share, decided):
    found = told(np.diag([1.0, share]), np.diag([1.0, 1.0 - share]), np.diag([1.0, 0.0]))
    assert found[0] == 0.0 and found[1] == pytest.approx(share if decided else 0.0)


def test_many_equal_windows_decide_together():
    assert (told(*[APART] * 5) == 0.0).all()


def test_the_window_that_alone_tells_two_parameters_apart_decides_both():
    assert told(*[TOGETHER] * 50, APART) == pytest.approx([1.0, 1.0])


def test_what_follows_from_holding_the_other_is_not_known_either():
    """The window says what the second is; the first is then known from their sum, but only then."""
    assert told(*[TOGETHER] * 50, np.diag([0.0, 1.0])) == pytest.approx([1.0, 1.0])


def test_units_do_not_matter_and_what_is_not_free_is_left_out():
    parts = np.array([np.diag([1.0, 1.0]), *[np.diag([1.0, 0.0])] * 9])
    unit = np.array([1e5, 1e-3])
    assert single_window(parts * np.outer(unit, unit), BOTH) == pytest.approx(single_window(parts, BOTH))
    assert (single_window(parts, np.array([True, False])) == 0.0).all()
    assert (single_window(parts, np.zeros(2, bool)) == 0.0).all()
