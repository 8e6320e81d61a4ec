"""A joint that a fit could not identify must not reach a training."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.errors import ConfigError
from hqpipe.rl.config import TrainConfig
from hqpipe.rl.policy_spec import RIGID, PolicySpec
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
    with pytest.raises(ConfigError, match="no stiffness at LFR"):
        spec(0.0, k2)


def test_a_joint_without_leak_is_rigid():
    assert spec(1e5, 0.0).position_stiffness[0] == RIGID
