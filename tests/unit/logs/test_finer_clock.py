"""Logs on the clock of a controller that is faster than they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hqpipe.logs.finer_clock import between, continued, held, known_so_far, steps_per_row
from hqpipe.logs.trajectory import Trajectory

STEPS = 5


@pytest.fixture
def trial() -> Trajectory:
    time = np.arange(40) * 0.005
    position = np.column_stack([np.sin(9.0 * time), np.cos(7.0 * time)])
    command = np.round(position, 1)
    observed = np.ones(position.shape, dtype=bool)
    observed[7, 1] = False
    return Trajectory(
        time, ("a", "b"), position, np.gradient(position, 0.005, axis=0), position_command=command, observed=observed
    )


@pytest.mark.parametrize(
    ("hertz", "steps"),
    [(4000.0, 1), (1000.0, 1), (800.0, 1), (500.0, 2), (400.0, 2), (200.0, 5), (100.0, 10), (50.0, 20), (9.0, 20)],
)
def test_steps_between_rows_are_near_a_millisecond(hertz, steps):
    assert steps_per_row(1.0 / hertz) == steps


@pytest.mark.parametrize("way", [between, held, continued])
def test_rows_stay_what_they_are(trial, way):
    found = way(trial.position, STEPS)
    np.testing.assert_allclose(found[::STEPS], trial.position, atol=1e-12)
    assert len(found) == (trial.samples - 1) * STEPS + 1
    assert way(trial.position, 1) is trial.position


def test_a_position_goes_on_smoothly_between_rows(trial):
    inside = slice(3 * STEPS, -3 * STEPS)  # a spline knows less at its ends
    fine = between(trial.time, STEPS)
    np.testing.assert_allclose(between(trial.position, STEPS)[inside, 0], np.sin(9.0 * fine[inside]), atol=1e-6)


def test_a_trial_on_a_finer_clock_holds_all_but_its_positions(trial):
    fine = known_so_far(trial, STEPS)
    np.testing.assert_array_equal(fine.position_command[:-1], np.repeat(trial.position_command[:-1], STEPS, axis=0))
    np.testing.assert_array_equal(fine.observed[::STEPS], trial.observed)
    np.testing.assert_allclose(fine.time[::STEPS], trial.time, atol=1e-12)
    assert fine.dt == pytest.approx(trial.dt / STEPS)


def test_what_is_known_so_far_looks_at_no_later_row(trial):
    fine = known_so_far(trial, STEPS)
    changed = replace(trial, **{name: np.concatenate([v[:20], 3.0 * v[20:]]) for name, v in trial.channels().items()})
    for name in trial.channels():
        np.testing.assert_array_equal(
            getattr(known_so_far(changed, STEPS), name)[: 20 * STEPS], getattr(fine, name)[: 20 * STEPS]
        )
    line = np.arange(12.0) ** 2
    np.testing.assert_allclose(continued(line, 2)[7::2], np.arange(3.0, 11.0) ** 2 + np.arange(3.0, 11.0) + 0.5)


def test_as_many_steps_as_rows_change_nothing(trial):
    assert known_so_far(trial, 1) is trial
