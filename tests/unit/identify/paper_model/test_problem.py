"""The bounded solvers and the windows they work on."""

from __future__ import annotations

import numpy as np
import pytest
from identify.small_logs import log_set, trajectory

from hqpipe.errors import IdentificationError
from hqpipe.identify.paper_model.problem import HELD, Problem, bounded_least_squares
from hqpipe.identify.windows import cut_windows, joint_data


@pytest.mark.parametrize("seed", range(20))
def test_bounded_least_squares_meets_its_optimality_conditions(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(30, 4)) * [1.0, 100.0, 0.01, 3.0]
    moments, right = x.T @ x, x.T @ rng.normal(size=30)
    lower, upper = np.zeros(4), np.array([np.inf, 1e-3, np.inf, np.inf])
    found = bounded_least_squares(moments, right, lower, upper)
    slope = (moments @ found - right) / np.sqrt(np.diag(moments))
    assert (found >= lower).all() and (found <= upper).all()
    inside = (found > lower) & (found < upper)
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-9)
    assert (slope[found == lower] >= -1e-9).all() and (slope[found == upper] <= 1e-9).all()


def test_windows_never_cross_trials_and_cover_all_but_short_ends():
    trials = log_set(trajectory(samples=251), trajectory(samples=320), splits=["fit", "fit"]).fit
    windows = cut_windows(trials, 0.1)
    np.testing.assert_array_equal(
        windows.bounds, [[0, 100], [100, 200], [200, 250], [251, 351], [351, 451], [451, 551]]
    )
    np.testing.assert_array_equal(windows.trial, [0, 0, 0, 1, 1, 1])
    assert len(joint_data(trials, "hip").effort) == 571


@pytest.mark.parametrize(
    ("trials", "words"),
    [
        ([trajectory(), trajectory(dt=2e-3)], "runs at 1000 Hz, the other trials at"),
        ([trajectory(position_command=None)], "position_command, which the logs lack"),
        ([trajectory(effort=None)], "joint/<name>/effort, which the logs lack"),
        ([trajectory(samples=30)], "no fit trial lasts as long as a window"),
    ],
)
def test_unusable_trials_are_named(trials, words):
    with pytest.raises(IdentificationError, match=words):
        cut_windows(log_set(*trials, splits=["fit"] * len(trials)).fit, 0.1)


def driven(gains, samples=1500, limit=np.inf):
    """A trial whose torque obeys eq. (7) from its own inputs."""
    trial = trajectory(samples=samples, joints=("hip",))
    error = (trial.position_command - trial.position)[:, 0]
    torque = np.zeros(samples)
    for k in range(samples - 1):
        h = error[k] * max(-torque[k] * np.sign(error[k]), 0.0)
        following = gains @ [error[k], -torque[k], -trial.velocity[k, 0], h] + torque[k]
        torque[k + 1] = np.clip(following, -limit, limit)
    return trajectory(samples=samples, joints=("hip",), effort=torque[:, None])


def problem_of(trial, limit=np.inf):
    trials = log_set(trial, splits=["fit"]).fit
    return Problem([joint_data(trials, "hip")], cut_windows(trials, 0.1), np.ones(1), np.array([limit]))


GAINS = np.array([400.0, 0.04, 8.0, 0.3])


@pytest.mark.parametrize("limit", [np.inf, 450.0])
def test_solver_finds_the_truth_from_afar(limit):
    problem = problem_of(driven(GAINS, limit=limit), limit)
    far = GAINS * [0.2, 3.0, 2.0, 0.0]
    solution = problem.fit(np.ones(4, bool), [far])
    np.testing.assert_allclose(solution.values, GAINS, rtol=1e-5)


def test_solver_respects_bounds_and_what_is_not_free():
    against = problem_of(driven(GAINS * [1, 1, -1, 1]))
    solution = against.fit(np.ones(4, bool), [GAINS])
    assert solution.values[2] == 0.0
    problem = problem_of(driven(GAINS))
    pinned = problem.fit(np.arange(4) < 3, [GAINS * [1, 1, 1, 0]])
    assert pinned.values[3] == 0.0 and pinned.at.cost > 1.0


def test_start_torques_follow_the_weight():
    """Held starts stay on the log; free ones move off a start sample that does not fit its window."""
    trial = driven(GAINS)
    effort = trial.effort.copy()
    effort[::100] += 50.0
    problem = problem_of(trajectory(samples=1500, joints=("hip",), effort=effort))
    everything = np.ones(4, bool)
    problem.start_weight[:] = HELD
    held = problem.fit(everything, [GAINS])
    np.testing.assert_allclose(held.starts[0], problem.measured_starts()[0], atol=1e-3)
    problem.start_weight[:] = 1.0
    free = problem.fit(everything, [GAINS])
    truth = trial.effort[problem.windows.bounds[:, 0], 0]
    assert np.abs(free.starts[0] - truth).mean() < 15.0
    assert np.abs(free.values / GAINS - 1).max() < np.abs(held.values / GAINS - 1).max()


def test_a_window_in_chaos_says_nothing():
    """An impact term that throws the torque over at every other sample forgets its start; the rest is rounding."""
    ones = np.ones((1500, 1))
    wanted, effort = 0.5 * ones, np.random.default_rng(1).uniform(-0.5, -0.3, (1500, 1))
    trial = trajectory(1500, ("hip",), position=0.0 * ones, velocity=ones, position_command=wanted, effort=effort)
    problem = problem_of(trial)
    problem.start_weight[:] = 1.0
    starts = problem.measured_starts()
    assert (problem.evaluate(np.array([0.0, 0.01, 1.0, 10.0]), starts)[0].hessians == 0.0).all()
    steady = problem.evaluate(np.array([0.0, 0.01, 1.0, 1.0]), starts)[0].hessians
    assert (np.diagonal(steady, axis1=1, axis2=2) > 0.0).all()
