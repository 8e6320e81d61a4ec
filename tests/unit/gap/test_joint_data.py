"""One joint of a log set, cut into windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, data_of, in_sections, logs_of

from hqpipe.effects import effect as scales
from hqpipe.effects.layout import slot
from hqpipe.gap.joint_data import LOGGED, MAX_WINDOWS, MOVED, by_opening, cut, joint_data, moved
from hqpipe.gap.set_fit import JointFitter


@pytest.fixture(scope="module")
def logs():
    return logs_of([{}, {}], seconds=2.0, fit=2)


def test_windows_lie_inside_their_trials_and_are_complete(logs):
    trials = [t.trajectory for t in logs.fit]
    split = cut(trials, 1, "position", STEPS)
    s = split.signals
    assert len(s.first) == 2 * 19 and list(np.unique(split.trial)) == [0, 1]
    assert list(s.bounds) == [0, 2000, 4000]
    assert np.all(s.bounds[split.trial] <= s.first) and np.all(s.first + STEPS < s.bounds[split.trial + 1])
    effort = np.concatenate([t.effort[:, 1] for t in trials])
    for w, first in enumerate(s.first):
        np.testing.assert_array_equal(s.target[:, w], effort[first : first + STEPS + 1])
    np.testing.assert_allclose(s.demand, np.concatenate([np.abs(t.velocity).sum(axis=1) for t in trials]))
    assert s.time[2000] == 0.0


def test_flow_of_the_openings_is_as_large_as_that_of_the_speeds(logs):
    trials = [t.trajectory for t in logs.fit]
    flow = by_opening(trials, "position")
    speed = np.concatenate([np.abs(t.velocity).sum(axis=1) for t in trials])
    opening = np.concatenate([np.abs(t.position_command - t.position).sum(axis=1) for t in trials])
    demand = cut(trials, 0, "position", STEPS, flow=flow).signals.demand
    np.testing.assert_allclose(demand / demand.max(), opening / opening.max())
    assert np.sqrt(np.mean(demand**2)) == pytest.approx(np.sqrt(np.mean(speed**2)))


def test_long_logs_are_thinned_evenly(logs):
    trial = logs.fit[0].trajectory
    split = cut([trial], 0, "position", 4)
    assert len(split.signals.first) == MAX_WINDOWS
    gaps = np.diff(split.signals.first)
    assert gaps.min() >= 4 and gaps.max() <= 8 and split.signals.first[-1] > 1980


def test_speed_of_the_positions_adds_up_to_the_travel(logs):
    t = logs.fit[0].trajectory
    coarse = np.round(t.position[:, 0] / 0.01) * 0.01
    speed = moved(coarse, 1e-3)
    assert speed[:-1].sum() * 1e-3 == pytest.approx(coarse[-1] - coarse[0])
    own = cut([t], 0, "position", STEPS, speed=MOVED).signals.velocity
    np.testing.assert_allclose(own[:-1], t.velocity[:-1, 0], atol=1e-9)
    late = replace(t, velocity=np.roll(t.velocity, 5, axis=0))
    np.testing.assert_array_equal(cut([late], 0, "position", STEPS).signals.velocity, own)
    logged = cut([late], 0, "position", STEPS, speed=LOGGED).signals.velocity
    np.testing.assert_array_equal(logged, late.velocity[:, 0])


def test_sizes_and_settings_come_from_the_fit_trials(logs):
    data = data_of(logs, 1)
    position = np.concatenate([t.trajectory.position[:, 1] for t in logs.fit])
    command = np.concatenate([t.trajectory.position_command[:, 1] for t in logs.fit])
    assert data.joint == logs.joints[1]
    assert data.size[scales.COMMAND] == pytest.approx(np.sqrt(np.mean((command - position) ** 2)))
    assert data.size[scales.DAMPING] == pytest.approx(data.size[scales.EFFORT] / data.size[scales.VELOCITY])
    assert data.row[slot("setting", "middle")] == pytest.approx(position.mean())
    assert data.row_dt == pytest.approx(1e-3)
    assert data.noise == pytest.approx(3.0, rel=0.15)
    assert data.output == data.size[scales.EFFORT]
    assert len(data.heldout.signals.first) == 19


def test_sections_keep_the_time_and_the_number_of_their_trial():
    whole = logs_of([{}], seconds=6.0)
    log_set = in_sections(whole, 1001, 2000)
    split = cut([t.trajectory for t in log_set.trials], 0, "position", STEPS)
    recorded = [0.0, 2.0, 4.0, 0.0, 2.0, 4.0]
    np.testing.assert_allclose(split.signals.time[split.signals.bounds[:-1]], recorded)
    assert (np.diff(split.signals.first) >= STEPS).all()
    np.testing.assert_array_equal(np.unique(split.trial), [0, 3])
    one = cut([t.trajectory for t in whole.trials], 0, "position", STEPS)
    for window, first in enumerate(split.signals.first):
        trial = int(np.searchsorted(split.signals.bounds, first, side="right")) - 1
        twin = one.signals.bounds[trial // 3] + round(split.signals.time[first] * 1e3)
        at = int(np.flatnonzero(one.signals.first == twin)[0])
        np.testing.assert_array_equal(split.signals.target[:, window], one.signals.target[:, at])


def unrecorded(t, rows):
    observed = np.ones(t.effort.shape, dtype=bool)
    observed[rows] = False
    return replace(t, observed=observed)


def test_a_sample_that_was_not_recorded_counts_for_nothing(logs):
    t = logs.fit[0].trajectory
    holes = unrecorded(t, np.r_[310:330, 777])
    wild = replace(holes, effort=np.where(holes.observed, holes.effort, 1e7))
    data = joint_data([holes], [t], 0, "position", STEPS, 1.0)
    fits = [JointFitter(replace(data, fit=cut([each], 0, "position", STEPS))).fit() for each in (holes, wild)]
    np.testing.assert_allclose(fits[0].row, fits[1].row, rtol=1e-6)  # the search begins elsewhere
    np.testing.assert_allclose(fits[0].fitted, fits[1].fitted, rtol=1e-6)


def test_no_window_starts_at_a_sample_that_was_not_recorded(logs):
    t = logs.fit[0].trajectory
    starts = cut([t], 0, "position", STEPS).signals.first
    holes = unrecorded(t, [starts[3], *range(starts[6] + 1, starts[6] + 80)])
    assert set(starts) - set(cut([holes], 0, "position", STEPS).signals.first) == {starts[3], starts[6]}
    assert np.isfinite(cut([holes], 0, "position", STEPS, masked=False).signals.target).all()
