"""Longer and longer beginnings of the fit trials, always the same held-out trials."""

from __future__ import annotations

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory

from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.rivals.data_curve import data_curve, first_seconds


class Constant:
    """Off by one over the seconds that it was fitted to."""

    def __init__(self, logs):
        self.offset = 1.0 / sum(trial.trajectory.duration for trial in logs.fit)

    def predict(self, trajectory, window):
        return trajectory.effort + self.offset


@pytest.fixture
def logs():
    trials = [trajectory(samples=1001), trajectory(samples=651, seed=1), trajectory(seed=2)]
    return log_set(*trials, splits=["fit", "fit", "heldout"])


def test_beginnings_are_whole_windows_and_run_on_into_the_next_trial(logs):
    def lengths(seconds):
        return [trial.trajectory.samples - 1 for trial in first_seconds(logs, seconds).fit]

    assert lengths(0.35) == [300]
    assert lengths(1.0) == [1000]
    assert lengths(1.2) == [1000, 200]
    assert lengths(9.0) == [1000, 600]
    cut = first_seconds(logs, 0.35)
    np.testing.assert_array_equal(cut.fit[0].trajectory.effort, logs.fit[0].trajectory.effort[:301])
    assert cut.heldout == logs.heldout


def test_less_than_a_window_is_refused(logs):
    with pytest.raises(IdentificationError, match="hold no window of 0.1 s"):
        first_seconds(logs, 0.05)


def test_every_fit_sees_every_length_and_the_logs_end_the_curve(logs):
    curve = data_curve(logs, {"a": Constant, "b": Constant}, [60.0, 0.5, 20.0, 1.0])
    assert [(p.model, round(p.seconds, 3)) for p in curve.points] == [(m, s) for m in "ab" for s in (0.5, 1.0, 1.6)]
    assert [p.free_run for p in curve.points[:3]] == pytest.approx([2.0, 1.0, 1.0 / 1.6])
    assert curve.persistence > curve.noise_floor > 0.0


def test_a_fit_that_refuses_leaves_a_reason_and_not_a_number(logs):
    def picky(given):
        if len(given.fit) < 2:
            raise IdentificationError("too little")
        return Constant(given)

    points = data_curve(logs, {"picky": picky, "easy": Constant}, [0.5, 1.6]).points
    assert (points[0].free_run, points[0].reason) == (None, "too little")
    assert points[1].free_run is not None and points[2].free_run is not None


def test_lengths_are_positive_and_something_is_held_out(logs):
    with pytest.raises(UsageError, match="expected seconds of fit data above 0, got -1"):
        data_curve(logs, {}, [1.0, -1.0])
    with pytest.raises(IdentificationError, match="no trial is held out"):
        data_curve(log_set(trajectory(), splits=["fit"]), {}, [1.0])
