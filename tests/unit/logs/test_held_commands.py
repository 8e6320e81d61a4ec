"""When, between two rows, the steps of a held command came."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.finer_clock import between, held
from hqpipe.logs.held_commands import command_between, steady_steps

PER_ROW = 4  # samples of a controller at 1 kHz from one row to the next of a log at 250 Hz


def commanded(time: np.ndarray, cycle_s: float, phase_s: float = 0.0) -> np.ndarray:
    """What a sender with a cycle gives at these times: a new value of a sine at the start of each cycle."""
    cycles = np.floor((time - phase_s) / cycle_s + 1e-9)
    return np.sin(0.21 * cycles)


def a_log(cycle_s: float, phase_s: float = 0.0, rows: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """The command on the clock of the controller, and in the rows of the log."""
    fine = commanded(1e-3 * np.arange((rows - 1) * PER_ROW + 1), cycle_s, phase_s)
    return fine, fine[::PER_ROW]


def test_steps_are_put_where_they_came_between_the_rows():
    fine, rows = a_log(0.010)
    late, early = command_between(rows, PER_ROW)
    assert np.array_equal(late, fine)
    assert np.mean(held(rows, PER_ROW) != fine) > 0.05  # what the rows alone would say
    assert np.mean(early != fine) < 0.21  # two phases of half a row each fit; one of them is true


def test_a_cycle_that_drifts_through_the_rows_leaves_next_to_nothing_open():
    found = steady_steps(a_log(0.0103, 0.0017)[1])
    assert found.cycle == pytest.approx(0.0103 / 0.004, rel=1e-5)
    true = (0.0103 * np.round((found.rows * 0.004 - 0.0017) / 0.0103 - 0.1) + 0.0017) / 0.004
    assert np.all(found.earliest <= true + 0.02)
    assert np.all(true <= found.latest + 0.02)
    assert np.max(found.latest - found.earliest) < 0.1


def test_a_cycle_of_whole_rows_leaves_a_whole_row_open():
    _, rows = a_log(0.008)
    found = steady_steps(rows)
    assert found.latest == pytest.approx(found.rows)
    assert found.earliest == pytest.approx(found.rows - 1)
    late, early = command_between(rows, PER_ROW)
    assert np.array_equal(late, held(rows, PER_ROW))
    assert np.array_equal(early[: -PER_ROW + 1], late[PER_ROW - 1 :])


def test_a_command_that_stays_for_some_cycles_keeps_its_cycle():
    cycles = np.floor(1e-3 * np.arange(6000) / 0.010 + 1e-9)
    cycles = np.where((cycles >= 120) & (cycles < 203) | (cycles == 307), 119.0, cycles)
    assert steady_steps(np.sin(0.21 * cycles)[::PER_ROW]).cycle == pytest.approx(2.5, rel=1e-5)


def test_one_step_off_the_cycle_refutes_it():
    rows = a_log(0.010)[1].copy()
    rows[499:502] = rows[498]
    assert steady_steps(rows) is None


@pytest.mark.parametrize("seed", range(3))
def test_an_unsteady_cycle_says_nothing(seed: int):
    steps = np.cumsum(0.010 + np.random.default_rng(seed).normal(0.0, 0.002, 700))
    fine = np.sin(0.21 * np.searchsorted(steps, 1e-3 * np.arange(6000), side="right"))
    rows = fine[::PER_ROW]
    assert steady_steps(rows) is None
    late, early = command_between(rows, PER_ROW)
    assert np.array_equal(late, held(rows, PER_ROW))
    assert np.array_equal(early, between(rows, PER_ROW))


def test_a_smooth_command_and_one_that_hardly_changes_have_no_cycle():
    smooth = np.sin(0.01 * np.arange(1000))
    smooth[100:130] = smooth[100]
    few = np.repeat(np.arange(6.0), 20)
    assert steady_steps(smooth) is None
    assert steady_steps(few) is None
    assert steady_steps(np.zeros(50)) is None
    assert steady_steps(np.cumsum(np.isin(np.arange(60) % 11, (0, 1)))) is None  # no gap is near the median of 1 and 10


def test_a_log_as_fast_as_the_controller_stays_as_it_is():
    fine, _ = a_log(0.010)
    late, early = command_between(fine, 1)
    assert np.array_equal(late, fine)
    assert np.array_equal(early, fine)
