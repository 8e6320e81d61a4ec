"""Windows that follow the machine: its response, its rate, its noise and how long its logs are."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from hqpipe.identify.free_run import WINDOW_S
from hqpipe.identify.window_choice import FEWEST_SAMPLES, LEAST_SAMPLES, MIN_WINDOWS, choose_window, window_for
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial

sys.path.insert(0, str(Path(__file__).parents[2] / "recovery"))
from planted_effects import logs_of

MODES = ("position", "torque")


def trial(rate, time_constants, seconds, seed, mode, noise, delay):
    """First-order joints; in position mode the output answers to the error of the position."""
    rng, dt, time = np.random.default_rng(seed), 1.0 / rate, np.arange(int(seconds * rate)) / rate
    rates = np.geomspace(0.05, min(5.0, rate / 6.0), 12)
    columns = []
    for constant in time_constants:
        wave = (rates**-0.3 * np.sin(2 * np.pi * np.outer(time, rates) + rng.uniform(0, 7, 12))).sum(axis=1)
        wave /= wave.std()
        late = round(delay / dt)
        shifted = np.concatenate([np.full(late + 1, wave[0]), wave])[: len(wave)]
        keep = np.exp(-dt / constant) if constant else 0.0
        output = lfilter([1.0 - keep], [1.0, -keep], shifted)
        columns.append((wave, output + noise * output.std() * rng.normal(size=len(time))))
    command, output = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    position = 0.1 * np.cumsum(command, axis=0) * dt
    channels = {"position": position, "velocity": np.gradient(position, dt, axis=0), "effort": output}
    name, drive = ("position_command", position + command) if mode == "position" else ("effort_command", command)
    channels[name] = drive
    return Trajectory(time=time, joints=tuple(f"j{i}" for i in range(len(time_constants))), **channels)


def machine(rate, *time_constants, mode="torque", seconds=(60.0, 60.0), noise=0.02, delay=0.0):
    trials = [trial(rate, time_constants, s, i, mode, noise, delay) for i, s in enumerate(seconds)]
    both = tuple(Trial(f"{s}.parquet", s, None, t) for s, t in zip(("fit", "heldout"), trials, strict=True))
    return LogSet(Path("x"), "", "hqpipe-log/1", None, None, mode, None, rate, trials[0].joints, both)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("rate", [100, 200, 1000, 5000])
@pytest.mark.parametrize("constant", [0.0, 0.01, 0.02])
def test_a_quick_joint_gets_the_usual_window_exactly(rate, constant, mode):
    assert choose_window(machine(rate, constant, mode=mode, seconds=(12.0, 12.0))).seconds == WINDOW_S


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("rate", [50, 100, 1000, 5000])
@pytest.mark.parametrize("constant", [0.3, 1.0])
def test_a_slow_joint_gets_windows_of_its_settling_time(rate, constant, mode):
    choice = choose_window(machine(rate, constant, mode=mode))
    assert constant <= choice.seconds <= 4.0 * constant
    assert "j0 takes" in choice.reason


@pytest.mark.parametrize(("rate", "seconds"), [(20, 0.5), (25, 0.4), (50, 0.2), (60, 0.167)])
def test_a_slow_log_gets_ten_samples(rate, seconds):
    choice = choose_window(machine(rate, 0.02))
    assert choice.seconds == seconds and choice.reason == f"{LEAST_SAMPLES} samples at {rate} Hz"


def test_the_slowest_joint_decides_and_is_named():
    choice = choose_window(machine(200, 0.02, 0.02, 0.6, 0.02))
    assert choice.seconds >= 0.6 and "j2" in choice.reason


def test_a_dead_time_is_part_of_the_response():
    assert choose_window(machine(100, 0.02, delay=0.5)).seconds > 0.5


def test_a_disturbance_that_the_inputs_know_nothing_of_is_no_response():
    """Slow drift as large as half of the output: an autoregression would take it for a memory of seconds."""
    logs = machine(200, 0.02)
    drift = np.cumsum(np.random.default_rng(0).normal(size=(logs.fit[0].trajectory.samples, 1)), axis=0)
    t = logs.fit[0].trajectory
    drifting = replace(t, effort=t.effort + 0.5 * t.effort.std() * drift / drift.std())
    assert choose_window(with_fit(logs, drifting)).seconds == WINDOW_S


def with_fit(logs, trajectory):
    return replace(logs, trials=(replace(logs.trials[0], trajectory=trajectory), *logs.trials[1:]))


def test_windows_are_longer_where_the_output_does_not_rise_above_its_noise_in_shorter_ones():
    choice = choose_window(machine(1000, 0.02, noise=0.5))
    assert choice.seconds > WINDOW_S and "noise" in choice.reason


@pytest.mark.parametrize("seconds", [(60.0, 12.0), (12.0, 60.0)])
def test_enough_windows_are_left_in_both_splits(seconds):
    logs = machine(100, 1.0, seconds=seconds)
    choice = choose_window(logs)
    for t in logs.trials:
        assert int(t.trajectory.duration / choice.seconds) >= MIN_WINDOWS
    assert choice.seconds > 0.3 and str(MIN_WINDOWS) in choice.reason


def test_short_slow_logs_get_fewer_samples_and_say_why():
    choice = choose_window(machine(20, 0.02, seconds=(6.0, 6.0)))
    assert FEWEST_SAMPLES / 20 <= choice.seconds <= 0.3 and "10 samples at 20 Hz" in choice.reason


def test_short_logs_keep_the_usual_window():
    """Whoever brings too little is told so; shorter windows would only hide it."""
    assert choose_window(machine(1000, 0.02, seconds=(3.0, 1.5))).seconds == WINDOW_S


def test_held_out_samples_have_no_say():
    logs = machine(100, 0.02)
    slow = machine(100, 1.0).heldout[0]
    other = replace(logs, trials=(logs.trials[0], replace(slow, trajectory=slow.trajectory)))
    assert choose_window(other) == choose_window(logs)
    assert choose_window(with_fit(logs, machine(100, 1.0).fit[0].trajectory)) != choose_window(logs)


def test_logs_like_the_plants_keep_the_window_that_results_were_made_with():
    logs = logs_of([{}, {"integral_action": {"ki": 0.3, "limit": 1.0}}, {"valve_lag": {"time_constant_s": 0.01}}])
    assert choose_window(logs).seconds == WINDOW_S


def test_what_is_asked_for_is_taken():
    assert window_for(machine(20, 1.0), 0.3).seconds == 0.3


def test_logs_without_a_command_get_ten_samples():
    logs = machine(25, 1.0)
    bare = tuple(replace(t, trajectory=replace(t.trajectory, effort_command=None)) for t in logs.trials)
    assert choose_window(replace(logs, control_mode=None, trials=bare)).seconds == 0.4


def test_a_joint_that_rests_decides_nothing():
    logs = machine(200, 0.02, 0.02)
    t = logs.fit[0].trajectory
    still = {name: np.where([True, False], getattr(t, name), 0.0) for name in ("effort", "effort_command", "velocity")}
    assert choose_window(with_fit(logs, replace(t, **still))).seconds == WINDOW_S
