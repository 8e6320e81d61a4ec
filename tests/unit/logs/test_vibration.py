"""A vibration that falling friction feeds is found, and what a pump, teeth, shocks or commands do is not taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.logs.trajectory import Trajectory
from hqpipe.logs.vibration import vibrations

DT, LENGTH = 1e-3, 20_000
TIME = DT * np.arange(LENGTH)


def trial(vibration: np.ndarray, *, commanded: np.ndarray | float = 0.0, seed: int = 0, every: int = 1) -> Trajectory:
    """Strokes of 1 s with 1 s of rest between them under a slow load of 20 N·m, with a vibration of the torque (T,) on top."""
    rng = np.random.default_rng(seed)
    effort = 20.0 * np.sin(2.0 * np.pi * 0.3 * TIME) + vibration + 0.2 * rng.standard_normal(LENGTH)
    velocity, command = _speed(), DT * np.cumsum(_speed()) + commanded
    columns = {
        "position": DT * np.cumsum(velocity),
        "velocity": velocity,
        "effort": effort,
        "position_command": command,
    }
    return Trajectory(TIME[::every], ("knee",), **{name: x[::every, None] for name, x in columns.items()})


def _speed() -> np.ndarray:
    stroke = np.where(TIME % 2.0 < 1.0, np.sin(np.pi * (TIME % 2.0)), 0.0)
    return 0.5 * stroke * np.where(TIME % 4.0 < 2.0, 1.0, -1.0)


SLIDES = np.abs(_speed()) > 0.05
LINE = np.sin(2.0 * np.pi * 140.0 * TIME)


def test_falling_friction_makes_the_torque_vibrate_while_the_joint_slides():
    (found,) = vibrations([trial(30.0 * SLIDES * LINE)])
    assert found.joint == "knee"
    assert found.frequency == pytest.approx(140.0, abs=1.0)
    assert found.amplitude == pytest.approx(30.0, rel=0.1)
    assert found.standing < 1.0
    assert "at 14" in found.text("N·m") and "while the joint slides" in found.text("N·m")


def test_it_may_do_so_at_low_speeds_only():
    slow = SLIDES & (np.abs(_speed()) < 0.35)
    assert vibrations([trial(30.0 * slow * LINE)])


def test_a_pump_is_heard_while_the_joint_stands_as_well():
    assert vibrations([trial(30.0 * LINE)]) == []


def test_the_frequency_of_teeth_rises_with_the_speed():
    teeth = np.sin(2.0 * np.pi * 400.0 * DT * np.cumsum(np.abs(_speed())))
    assert vibrations([trial(30.0 * SLIDES * teeth)]) == []


def test_shocks_ring_down():
    rings = np.exp(-(TIME % 0.5) / 0.02) * LINE
    assert vibrations([trial(60.0 * SLIDES * rings)]) == []


def test_what_is_commanded_is_no_vibration():
    assert vibrations([trial(30.0 * SLIDES * LINE, commanded=0.01 * SLIDES * LINE)]) == []


def test_a_weak_one_is_not_told():
    assert vibrations([trial(3.0 * SLIDES * LINE)]) == []


def test_a_slow_motion_of_the_torque_is_no_vibration():
    assert vibrations([trial(30.0 * SLIDES * np.sin(2.0 * np.pi * 12.0 * TIME))]) == []


def test_a_joint_that_never_stands_shows_nothing():
    moving = trial(30.0 * LINE)
    always = Trajectory(TIME, moving.joints, moving.position, np.full((LENGTH, 1), 0.3), moving.effort)
    assert vibrations([always]) == []


def test_trials_without_torque_and_at_another_rate_say_nothing():
    silent = trial(30.0 * SLIDES * LINE)
    without = Trajectory(TIME, silent.joints, silent.position, silent.velocity)
    assert vibrations([without]) == [] and vibrations([]) == []
    whole = [trial(30.0 * SLIDES * LINE, seed=seed) for seed in (1, 2)]
    assert vibrations([*whole, trial(np.zeros(LENGTH), every=4)])[0].amplitude == pytest.approx(30.0, rel=0.1)
    assert vibrations([whole[0], trial(np.zeros(LENGTH), every=4)]) == [], "the slower one of two is the middle one"


def test_logs_too_short_for_a_median_show_nothing():
    short = trial(30.0 * SLIDES * LINE)
    part = slice(0, 2_000)
    few = Trajectory(
        TIME[part],
        short.joints,
        short.position[part],
        short.velocity[part],
        short.effort[part],
        short.position_command[part],
    )
    assert vibrations([few]) == []
