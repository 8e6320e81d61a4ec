"""Differentiation without delay, resampling, and sections of a trial."""

from __future__ import annotations

import numpy as np
import pytest
from log_builders import make_columns

from hqpipe.errors import LogError
from hqpipe.logs.assemble import assemble
from hqpipe.logs.columns import RawTable
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.repair.resample import resample


@pytest.mark.parametrize("rate", [1000.0, 200.0, 50.0])
def test_a_cubic_is_differentiated_exactly(rate):
    t = np.arange(200) / rate
    position = np.stack([0.3 + 2 * t - t**2, 0.5 * t**3], axis=1)
    truth = np.stack([2 - 2 * t, 1.5 * t**2], axis=1)
    np.testing.assert_allclose(differentiate(position, 1 / rate), truth, atol=1e-8)


def test_no_phase_and_little_noise():
    t = np.arange(4000) / 1000.0
    rng = np.random.default_rng(0)
    noisy = np.sin(2 * np.pi * 5 * t)[:, None] + 1e-5 * rng.normal(size=(4000, 1))
    truth = 2 * np.pi * 5 * np.cos(2 * np.pi * 5 * t)
    velocity = differentiate(noisy, 1e-3)[:, 0]
    inner = slice(50, -50)
    lag = [np.mean((velocity[50 + k : 3950 + k] - truth[inner]) ** 2) for k in (-1, 0, 1)]
    assert np.argmin(lag) == 1
    plain = np.gradient(noisy[:, 0], 1e-3)
    assert np.std(velocity[inner] - truth[inner]) < 0.3 * np.std(plain[inner] - truth[inner])


def test_resampling_interpolates_signals_and_holds_commands(tmp_path):
    time = np.array([0.0, 0.9, 2.1, 3.0, 4.0])
    table = RawTable(
        tmp_path,
        {
            "time": time,
            "joint/a/position": 2.0 * time,
            "joint/a/position_command": np.array([0.0, 1.0, 2.0, 3.0, 4.0]),
        },
    )
    columns = resample(table, 1.0).table.columns
    np.testing.assert_allclose(columns["time"], [0, 1, 2, 3, 4])
    np.testing.assert_allclose(columns["joint/a/position"], [0, 2, 4, 6, 8])
    np.testing.assert_array_equal(columns["joint/a/position_command"], [0, 1, 1, 3, 4])


def test_sections_and_joint_choice(tmp_path):
    trial = assemble(RawTable(tmp_path, make_columns()))
    part = trial.section(500, 800).for_joints(("knee",))
    assert part.samples == 300 and part.time[0] == 0.0
    np.testing.assert_array_equal(part.effort[:, 0], trial.effort[500:800, 1])
    with pytest.raises(LogError, match="did you mean 'knee'"):
        trial.for_joints(("kne",))
