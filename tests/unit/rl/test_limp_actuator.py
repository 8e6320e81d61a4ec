"""A joint that a fit could not identify must not reach a training."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.settled import ERROR_RAD
from hqpipe.actuators.two_chamber import TwoChamber
from hqpipe.errors import ConfigError
from hqpipe.rl.config import TrainConfig
from hqpipe.rl.policy_spec import RIGID, PolicySpec, position_stiffness
from hqpipe.robots import load_robot


def spec(k1: float, k2: float) -> PolicySpec:
    robot = load_robot("hydraulic_quadruped")
    first = np.array([k1] + [1e5] * 11), np.array([k2] + [0.07] * 11)
    model = ACTUATOR_MODELS["hydraulic"].build(
        robot.joints,
        dt=1e-3,
        k1=first[0],
        k2=first[1],
        k3=4e3,
        k4=0.0,
        sprocket_radius=robot.sprocket_radius,
        effort_limit=robot.effort_limit,
    )
    return PolicySpec.build(robot, model, TrainConfig())


@pytest.mark.parametrize("k2", [0.0, 0.07])
def test_unidentified_joint_is_named(k2):
    with pytest.raises(ConfigError, match="does not push a held joint back at LFR"):
        spec(0.0, k2)


def test_a_joint_without_leak_is_rigid():
    assert spec(1e5, 0.0).position_stiffness[0] == RIGID


def test_two_chambers_are_as_stiff_as_they_settle():
    chambers = TwoChamber.build(
        ("knee", "hip"), dt=1e-3, full_torque=900.0, stiffness=2e4, flow_gain=25.0, valve_lag=1e-3, leakage=[3.0, 6.0],
        null_opening=0.0, volume_slope=0.4, coulomb_friction=0.0, viscous_friction=0.0, speed_limit=np.inf,
        middle=[-1.1, 0.5], sample_time=1e-3, effort_limit=[np.inf, 5.0],
    )  # fmt: skip
    stiff, limited = position_stiffness(chambers)
    assert stiff > 0.0  # leakage stops what the valve feeds in
    assert limited == pytest.approx(5.0 / ERROR_RAD)
