"""Samples at which a joint touches an end stop, and the windows that they spoil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from torque_strokes import STOP, log_set, rest_log_set

from hqpipe.gap.joint_data import cut, joint_data
from hqpipe.gap.replay import Replay, persistence_error
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
    ram, swing = (cut([t], j, "torque", STEPS) for j in (0, 1))
    assert ram.signals.first.tolist() == (STEPS * np.flatnonzero(judged[:, 0])).tolist()
    assert len(swing.trial) == len(judged)
    assert np.array_equal(ram.machine_first, swing.signals.first)


def test_errors_keep_their_mean_in_the_places_of_the_machines_windows(marked):
    split = cut([marked.trials[0].trajectory], 0, "torque", STEPS)
    errors = np.arange(1.0, len(split.trial) + 1.0)
    placed = split.of_machine(errors)
    assert len(placed) == len(split.machine_first) and np.flatnonzero(placed).tolist() == split.window.tolist()
    assert placed.mean() == pytest.approx(errors.mean())


def test_what_is_logged_at_the_stop_counts_for_nothing(marked):
    """Any other torque there gives the same sizes, windows and errors."""

    def other(trial):
        t = trial.trajectory
        return replace(t, effort=np.where(at_end_stop(t), 1e6, t.effort))

    def judged(trials):
        data = joint_data(trials, trials, 0, "torque", STEPS, 0.0)
        item = Replay("", trials[0], STEPS, np.zeros(trials[0].effort.shape), np.zeros(trials[0].effort.shape))
        return data.size, data.scale, data.fit.signals.target.tolist(), persistence_error([item]).tolist()

    assert judged([x.trajectory for x in marked.trials]) == judged([other(x) for x in marked.trials])


def test_replays_count_what_is_judged(marked):
    t = marked.trials[0].trajectory
    item = Replay("", t, STEPS, np.zeros(t.effort.shape), np.zeros(t.effort.shape))
    judged = judged_windows(t, STEPS)
    assert item.windows == len(judged)  # one of the joints is judged in each
    assert np.array_equal(item.targets(item.counts)[:, 0], judged)
    assert not item.targets(item.residual)[~judged[:, 0], :, 0].any()
    alone = replace(item, trajectory=t.for_joints(("ram",)), predicted=item.predicted[:, :1])
    assert alone.windows == int(judged[:, 0].sum())
    assert len(alone.targets(alone.residual)) == len(alone.inputs(alone.residual)) == alone.windows
