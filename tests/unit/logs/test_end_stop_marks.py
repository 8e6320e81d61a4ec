"""Samples at which a joint touches an end stop, and the windows that they spoil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from torque_strokes import STOP, log_set, rest_log_set

from hqpipe.gap.checks.base_fit import BaseFit
from hqpipe.layers.actuator.record import window_starts
from hqpipe.logs.end_stops import at_end_stop, judged_windows, mark_end_stops

STEPS = 50


@pytest.fixture(scope="module")
def marked():
    return mark_end_stops(log_set())[0]


def test_a_joint_that_is_pushed_against_its_stop_is_marked_there(marked):
    t = marked.trials[0].trajectory
    marks = at_end_stop(t)
    assert not marks[:, 1].any()
    reached = np.abs(t.position[:, 0])
    assert marks[reached > STOP - 1e-3, 0].all() and not marks[reached < STOP - 5e-3, 0].any()
    (text,) = mark_end_stops(log_set())[1]
    assert text.startswith("ram rests on or hits an end stop near ")
    assert f"{sum(int(at_end_stop(x.trajectory).sum()) for x in marked.trials)} samples" in text


def test_logs_without_a_stop_stay_as_they_are():
    free = log_set(stop=np.inf)
    assert mark_end_stops(free) == (free, ())
    assert at_end_stop(free.trials[0].trajectory) is None and judged_windows(free.trials[0].trajectory, STEPS) is None


def test_a_load_that_is_held_at_rest_is_no_stop():
    held = rest_log_set()
    assert mark_end_stops(held) == (held, ())


def test_stated_limits_are_stops_unless_the_joint_passes_them():
    free = log_set(stop=np.inf)
    reach = float(np.max([np.abs(t.trajectory.position[:, 1]).max() for t in free.trials]))
    assert at_end_stop(mark_end_stops(free, {"swing": (-reach, reach)})[0].trials[0].trajectory) is not None
    assert mark_end_stops(free, {"swing": (-0.5 * reach, 0.5 * reach)})[0] is free
    assert mark_end_stops(free, {"swing": (-2.0 * reach, 2.0 * reach)})[0] is free


def test_marks_follow_joints_and_sections(marked):
    t = marked.trials[0].trajectory
    marks = at_end_stop(t)
    assert np.array_equal(at_end_stop(t.for_joints(("swing", "ram"))), marks[:, ::-1])
    assert np.array_equal(at_end_stop(t.section(300, 900)), marks[300:900])


def test_no_window_holds_a_marked_sample_and_no_other_is_lost(marked):
    t = marked.trials[0].trajectory
    marks, judged = at_end_stop(t), judged_windows(t, STEPS)
    for w, start in enumerate(range(0, t.samples - STEPS, STEPS)):
        assert np.array_equal(judged[w], ~marks[start : start + STEPS + 1].any(axis=0))
        for j in (0, 1):
            assert (start in window_starts(t, j, STEPS)) == judged[w, j]


def test_what_is_logged_at_the_stop_counts_for_nothing(marked):
    """Any other torque there gives the same windows and errors."""

    def other(trial):
        t = trial.trajectory
        return replace(t, effort=np.where(at_end_stop(t), 1e6, t.effort))

    def judged(trials):
        fit = BaseFit.of(trials, 0, "torque", STEPS, logged_speed=True)
        return fit.mean_square, fit.errors().tolist()

    assert judged([x.trajectory for x in marked.trials]) == judged([other(x) for x in marked.trials])
