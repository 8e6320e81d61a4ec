"""Gantry excitation stays inside the limits and excites."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.errors import UsageError
from hqpipe.plant.excitation import KINDS, PEAK_RATE, excitation


@pytest.mark.parametrize("kind", KINDS)
def test_targets_respect_position_and_speed_limits(robot, kind):
    signal = excitation(robot, kind, duration=10.0, seed=1)
    targets = np.stack([signal.at(t) for t in np.arange(0.0, 10.0, 0.002)])
    assert (targets > robot.position_lower).all()
    assert (targets < robot.position_upper).all()
    assert np.abs(np.diff(targets[500:], axis=0)).max() / 0.002 < 1.05 * PEAK_RATE
    assert (np.ptp(targets, axis=0) > 0.3).all()
    np.testing.assert_allclose(targets[0], robot.nominal_position)


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_excited_independently_and_reproducibly(robot, kind):
    grid = np.arange(0.0, 20.0, 0.01)
    signals = [excitation(robot, kind, 20.0, seed) for seed in (5, 5, 6)]
    first, again, other = (np.stack([signal.at(t) for t in grid]) for signal in signals)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.05
    if kind == "multisine":
        correlation = np.corrcoef(first.T) - np.eye(12)
        assert np.abs(correlation).max() < 0.75


def test_unknown_kind(robot):
    with pytest.raises(UsageError, match="did you mean 'multisine'"):
        excitation(robot, "multisin")
