"""The two-chamber model as an actuator model."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.files import load_actuator, save_actuator
from hqpipe.actuators.loops.chamber_step import LIMIT, SAMPLE_TIME, SPEED
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.errors import UsageError

JOINTS = ("knee", "hip")


@pytest.fixture
def model():
    return TwoChamber.build(
        JOINTS, dt=1e-3, full_torque=900.0, stiffness=[2e4, 1.8e4], flow_gain=25.0, valve_lag=0.0015, leakage=3.0,
        null_opening=0.001, volume_slope=0.4, coulomb_friction=0.0, viscous_friction=0.0, speed_limit=np.inf,
        middle=[-1.1, 0.5], sample_time=1e-3, effort_limit=950.0,
    )  # fmt: skip


def run(model, dt, seconds=0.05):
    tau, memory = np.full((1, 2), 50.0), model.fresh_memory(1)
    q = np.array([[-1.1, 0.5]])
    for _ in range(round(seconds / dt)):
        model.step(tau, memory, q + 0.02, q, np.zeros((1, 2)), dt)
    return tau


def test_columns_are_those_of_the_kernel():
    names = list(TwoChamber.FIELDS)
    assert [names[i] for i in (SPEED, SAMPLE_TIME, LIMIT)] == ["speed_limit", "sample_time", "effort_limit"]


def test_another_rate_is_the_same_machine(model):
    np.testing.assert_allclose(run(model.at_rate(5e-4), 5e-4), run(model, 1e-3), rtol=5e-3)


def test_refuses_a_rate_it_was_not_set_to(model):
    with pytest.raises(UsageError, match="sample of 0.001 s"):
        run(model, 2e-3)


def test_the_disk_keeps_the_next_torque(model, tmp_path):
    save_actuator(model, tmp_path)
    np.testing.assert_array_equal(run(load_actuator(tmp_path), 1e-3), run(model, 1e-3))
