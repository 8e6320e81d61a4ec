"""Wrong units and wrong wiring are warned about, with the factor; a sound log raises no suspicion."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import make_columns, put

from hqpipe.logs.log_set import read_log_set


def warnings(logs, change, manifest=""):
    for file, seed in (("a.parquet", 0), ("b.parquet", 1)):
        columns = make_columns(seed=seed)
        change(columns)
        put(logs, file, columns)
    if manifest:
        (logs / "logset.yaml").write_text(
            f"format: hqpipe-log/1\n{manifest}\ntrials:\n"
            "  - {file: a.parquet, split: fit}\n  - {file: b.parquet, split: heldout}\n"
        )
    return [w for w in read_log_set(logs).warnings if not w.startswith("no logset.yaml")]


def scale(*names, by):
    def change(columns):
        for name in names:
            columns[name] = columns[name] * by

    return change


def add(name, values):
    return lambda columns: columns.update({name: values})


def test_a_sound_log_raises_none(logs):
    assert warnings(logs, lambda columns: None) == []


BOTH = ("joint/hip/position", "joint/hip/position_command")
QUAT = {f"base/orientation/{a}": np.full(2000, v) for a, v in zip("xyzw", (0, 0, 0, 2.0), strict=True)}
ACC = {f"imu/linear_acceleration/{a}": np.full(2000, v) for a, v in zip("xyz", (0, 0, 1.0), strict=True)}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (scale(*BOTH, by=180 / np.pi), "in every trial: joint/hip/position reaches 22.9"),
        (
            scale("joint/hip/position_command", by=180 / np.pi),
            "the first is in degrees, the second in radians",
        ),
        (scale("joint/hip/velocity", by=180 / np.pi), "joint/hip/velocity is 57"),
        (scale("joint/hip/velocity", by=1000), "the first is in mm, the second in m"),
        (scale("joint/hip/velocity", by=-1), "runs against the derivative of its position"),
        (add("joint/hip/pressure_a", np.linspace(100, 210, 2000)), "looks like bar (×1e5)"),
        (add("supply/pressure", np.full(2000, 3000.0)), "looks like psi"),
        (add("base/position/z", np.full(2000, 1300.0)), "looks like mm"),
        (lambda c: c.update(QUAT), "has a norm of 2, expected 1"),
        (lambda c: c.update(ACC), "looks like g (×9.80665)"),
        (scale("time", by=1e6), "time steps by 1000: looks like µs (×1e-6)"),
        (scale("time", by=1e3), "time steps by 1: looks like ms (×0.001)"),
    ],
)
def test_units(logs, change, words):
    def both(columns):
        change(columns)
        if "joint/hip/pressure_a" in columns:
            columns["joint/knee/pressure_a"] = columns["joint/hip/pressure_a"] * 1e5

    found = warnings(logs, both)
    assert any(words in text for text in found), found


def turning(turns, factor=1.0, velocity=True):
    """The hip turns on and on, `turns` times in all, and comes back."""

    def change(columns):
        time = columns["time"]
        phase = np.pi * time / time[-1]
        angle = 2 * np.pi * turns * np.sin(phase) ** 2
        columns["joint/hip/position"] = columns["joint/hip/position_command"] = angle * factor
        for joint in ("hip", "knee"):
            del columns[f"joint/{joint}/velocity"]
            if velocity:
                columns[f"joint/{joint}/velocity"] = np.gradient(columns[f"joint/{joint}/position"] / factor, time)

    return change


def degrees(found):
    return [text for text in found if "joint/hip/position reaches" in text and "looks like degrees" in text]


def test_a_joint_that_spins_is_not_taken_for_one_in_degrees(logs):
    assert degrees(warnings(logs, turning(5))) == []


def test_what_spins_in_any_unit_is_not_taken_for_degrees(logs):
    assert degrees(warnings(logs, turning(300, velocity=False))) == []


def test_a_velocity_that_is_off_by_another_factor_speaks_against_degrees(logs):
    assert degrees(warnings(logs, turning(5, factor=2.0))) == []


def test_degrees_beside_a_velocity_in_radians_are_told(logs):
    assert degrees(warnings(logs, turning(0.4, factor=180 / np.pi)))


def test_without_a_velocity_turns_and_degrees_cannot_be_told_apart(logs):
    (text,) = degrees(warnings(logs, turning(5, velocity=False)))
    assert "unless it spins" in text


def test_a_position_that_starts_again_after_a_turn_is_told(logs):
    def wrap(columns):
        turning(2.5, velocity=False)(columns)
        columns["joint/hip/position"] = np.mod(columns["joint/hip/position"], 2 * np.pi)

    found = warnings(logs, wrap)
    assert any("joint/hip/position starts again after a turn (4 times)" in text for text in found), found


def test_the_range_after_which_a_position_starts_again_is_told(logs):
    def wrap(columns):
        time = columns["time"]
        angle = 20.0 * np.sin(2.0 * np.pi * 2.0 * time / time[-1])
        columns["joint/hip/position"] = np.mod(angle + 12.5, 25.0) - 12.5

    found = warnings(logs, wrap)
    assert any("joint/hip/position starts again after 25 rad (8 times)" in text for text in found), found


def test_units_of_the_clock_against_the_stated_rate(logs):
    found = warnings(logs, scale("time", by=1e3), "rate_hz: 1000")
    assert any("time steps by 1 where rate_hz says 0.001: looks like ms" in w for w in found), found
    found = warnings(logs, lambda c: None, "rate_hz: 500")
    assert any("rate_hz is 500 but time runs at 1000 Hz" in w for w in found), found


def swap(first, second):
    def change(columns):
        columns[first], columns[second] = columns[second], columns[first]

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (swap("joint/hip/effort", "joint/knee/effort"), "effort of joints hip and knee may be swapped"),
        (
            swap("joint/hip/position_command", "joint/knee/position_command"),
            "position of joints hip and knee may be swapped",
        ),
        (scale("joint/knee/effort", by=-1), "joint/knee/effort opposes its position error"),
        (scale("joint/knee/position_command", by=-1), "joint/knee/position_command runs against"),
        (lambda c: c.update({"joint/hip/effort": np.abs(c["joint/hip/effort"])}), "lost the sign"),
        (
            lambda c: c.update({"joint/hip/effort": np.clip(c["joint/hip/effort"], -150, 150)}),
            "joint/hip/effort is saturated at ",
        ),
        (scale("joint/hip/effort", by=0.0), "in every trial: joint/hip/effort is constant"),
    ],
)
def test_wiring(logs, change, words):
    found = warnings(logs, change)
    assert any(words in text for text in found), found


def test_a_square_wave_command_is_not_saturated(logs):
    def change(columns):
        columns["joint/hip/effort"] = np.sign(columns["joint/hip/effort"]) * 100.0

    assert not any("saturated" in text for text in warnings(logs, change))


def following(columns, samples, gain=1.0, noise=0.0):
    """The hip follows an uneven command `samples` later."""
    time = np.arange(-samples, 2000) * 1e-3
    command = 0.3 * np.sin(8.0 * time) + 0.12 * np.sin(19.0 * time + 1.0)
    position = gain * command[: len(command) - samples] + noise * np.sin(60.0 * time[samples:])
    columns["joint/hip/position_command"], columns["joint/hip/position"] = command[samples:], position
    columns["joint/hip/velocity"] = np.gradient(position, 1e-3)


OPPOSES = "joint/hip/position opposes its position command"


def test_a_slow_joint_is_not_called_flipped(logs):
    columns = make_columns()
    following(columns, 340)
    assert np.corrcoef(columns["joint/hip/position"], columns["joint/hip/position_command"])[0, 1] < -0.5
    found = warnings(logs, lambda c: following(c, 340))
    assert not any(OPPOSES in text for text in found), found
    found = warnings(logs, lambda c: following(c, 20, gain=-1.0))
    assert any(OPPOSES in text for text in found), found


def test_what_another_trial_shows_far_more_clearly_counts(logs):
    """A joint that its load moves, less than its overlap is wide, may stand against a command that answers to it."""
    moved, again, follows = (make_columns(seed=seed) for seed in range(3))
    following(moved, 0, gain=-0.04, noise=0.008)
    following(again, 0, gain=-0.04, noise=0.008)
    following(follows, 5)
    put(logs, "a.parquet", moved)
    put(logs, "b.parquet", again)
    assert any(OPPOSES in text for text in read_log_set(logs).warnings)
    put(logs, "b.parquet", follows)
    assert not any(OPPOSES in text for text in read_log_set(logs).warnings)


def test_a_joint_that_is_flipped_in_one_trial_only_is_still_called_so(logs):
    columns = make_columns(seed=0)
    for name in ("position", "velocity"):
        columns[f"joint/hip/{name}"] = -columns[f"joint/hip/{name}"]
    put(logs, "a.parquet", columns)
    put(logs, "b.parquet", make_columns(seed=1))
    assert any(OPPOSES in text and "a.parquet" in text for text in read_log_set(logs).warnings)
