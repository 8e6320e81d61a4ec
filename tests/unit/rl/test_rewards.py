"""Every term against a number worked out by hand from the paper's tables."""

from __future__ import annotations

from dataclasses import fields
from math import exp, sqrt

import numpy as np
import pytest

from hqpipe.rl import rewards
from hqpipe.rl.reward_config import RewardConfig


def step(**changes) -> rewards.Step:
    """One robot, two joints, two feet, at rest, with exactly what a test changes."""
    values = {
        "command": np.zeros((1, 3)),
        "linear_velocity": np.zeros((1, 3)),
        "angular_velocity": np.zeros((1, 3)),
        "mean_error": np.zeros((1, 3)),
        "gravity": np.array([[0.0, 0.0, -1.0]]),
        "height": np.array([0.8]),
        "nominal_height": 0.8,
        "torque_square": np.zeros((1, 2)),
        "torque_clip": np.zeros((1, 2)),
        "position": np.zeros((1, 2)),
        "velocity": np.zeros((1, 2)),
        "previous_velocity": np.zeros((1, 2)),
        "nominal_position": np.zeros(2),
        "lower": np.full(2, -1.0),
        "upper": np.full(2, 1.0),
        "targets": np.zeros((1, 3, 2)),
        "target_clip": np.zeros((1, 2)),
        "contact": np.ones((1, 2), dtype=bool),
        "air_time": np.zeros((1, 2)),
        "stance_time": np.ones((1, 2)),
        "foot_velocity": np.zeros((1, 2, 3)),
        "foot_height": np.zeros((1, 2)),
        "previous_clearance": np.zeros((1, 2)),
        "foot_force": np.zeros((1, 3, 2)),
        "clearance_target": 0.1,
        "opposite": np.array([1, 0]),
    }
    rows = {k: np.array(v) if isinstance(v, list) else v for k, v in changes.items()}
    return rewards.Step(**{**values, **rows})


WALK = [[1.0, 0.0, 0.0]]
TURN = [[0.0, 0.0, 0.5]]

CASES = [
    ("command", {}, 3.0),
    (
        "command",
        {"command": [[1.0, 0.0, 0.5]], "linear_velocity": [[0.4, 0.8, 0.0]]},
        exp(-1.0) * (1.0 + exp(-0.5)) + exp(-1.5 * 0.25),
    ),
    ("yaw", {"angular_velocity": [[0.0, 0.0, 0.2]]}, 10.0 * 0.04),
    ("yaw", {"command": TURN, "angular_velocity": [[0.0, 0.0, 0.2]]}, 0.09),
    ("base_height", {"height": [0.85]}, exp(-2.0)),
    (
        "base_motion",
        {"linear_velocity": [[1.0, 1.0, 0.3]], "angular_velocity": [[-0.5, 0.25, 9.0]]},
        0.09 + 0.02 * 0.75,
    ),
    ("torque", {"torque_square": [[100.0, 25.0]]}, 125.0),
    ("torque_clip", {"torque_clip": [[3.0, 4.0]]}, 25.0),
    ("nominal_position", {"position": [[0.3, 0.4]]}, 5.0),
    ("nominal_position", {"position": [[0.3, 0.4]], "command": WALK}, 0.5),
    ("joint_velocity", {"velocity": [[2.0, -1.0]]}, 5.0),
    ("joint_acceleration", {"velocity": [[2.0, 0.0]], "previous_velocity": [[0.0, 1.0]]}, 5.0),
    ("action_smoothness", {"targets": [[[0.3, 0.0], [0.1, 0.0], [0.1, 0.2]]]}, 0.5 * (0.04 + 0.04) + 0.04),
    ("flight", {"contact": [[False, False]]}, 1.0),
    ("flight", {"contact": [[False, True]]}, 0.0),
    ("airtime", {"contact": [[True, False]], "stance_time": [[0.1, 0.0]], "air_time": [[0.0, 0.4]]}, 0.1 - 0.25),
    (
        "airtime",
        {
            "command": WALK,
            "contact": [[True, False]],
            "stance_time": [[0.22, 0.0]],
            "air_time": [[0.0, 0.15]],
        },
        0.2 + 0.15,
    ),
    (
        "airtime",
        {
            "command": WALK,
            "contact": [[True, False]],
            "stance_time": [[0.26, 0.0]],
            "air_time": [[0.0, 0.3]],
        },
        0.0,
    ),
    (
        "slip",
        {"contact": [[True, False]], "foot_velocity": [[[0.3, 0.4, 5.0], [9.0, 9.0, 9.0]]]},
        0.25,
    ),
    (
        "clearance_1",
        {
            "command": WALK,
            "contact": [[False, True]],
            "foot_velocity": [[[3.0, 0.0, 4.0], [1.0, 0.0, 0.0]]],
            "foot_height": [[0.3, 0.0]],
        },
        5.0 * 0.04,
    ),
    (
        "clearance_1",
        {"contact": [[False, True]], "foot_velocity": [[[3.0, 0.0, 4.0], [1.0, 0.0, 0.0]]]},
        0.0,
    ),
    ("clearance_2", {"contact": [[True, False]], "previous_clearance": [[0.2, 0.7]]}, 0.2),
    ("grf_smoothness", {"foot_force": [[[30.0, 0.0], [10.0, 0.0], [10.0, 20.0]]]}, 0.5 * (400 + 400) + 400),
    ("action_clip", {"target_clip": [[-0.2, 0.1]]}, 0.3),
    ("joint_limit", {"position": [[1.1, -1.1]]}, 2.0),
    ("tracking", {"command": WALK, "linear_velocity": [[0.8, 0.1, 0.0]]}, exp(-0.5)),
    ("tracking_yaw", {"angular_velocity": [[0.0, 0.0, 0.1]]}, exp(-0.1)),
    ("mean_speed", {"mean_error": [[-0.3, 0.4, 7.0]]}, 0.5),
    ("mean_yaw", {"mean_error": [[7.0, 7.0, -0.2]]}, 0.2),
    (
        "gait_match",
        {"command": WALK, "contact": [[True, False]], "scheduled_stance": np.array([[False, False]])},
        0.5,
    ),
    ("gait_match", {"scheduled_stance": np.array([[False, False]])}, 1.0),
    ("gait_match", {}, 0.0),
    *(
        (
            "lift",
            {"command": WALK, "contact": [[True, True, False, False]], "foot_height": [[0.0, 0.0, 0.05, 0.2]], **more},
            paid,
        )
        for more, paid in (
            ({"air_time": [[0.0, 0.0, 0.1, 0.29]]}, 1.5),
            ({"air_time": [[0.0, 0.0, 0.1, 0.31]]}, 0.5),  # held up, no swing
            ({"air_time": [[0.0, 0.0, 0.1, 0.1]], "command": [[0.0, 0.0, 0.0]]}, 0.0),
            ({"air_time": [[0.0, 0.2, 0.1, 0.1]], "contact": [[True, False, False, False]]}, 0.0),  # hops
        )
    ),
    ("late", {"command": WALK, "air_time": [[0.3, 0.0]], "stance_time": [[0.0, 0.6]]}, 2.0),
    ("late", {"command": WALK, "air_time": [[0.29, 0.0]], "stance_time": [[0.0, 0.59]]}, 0.0),
    ("late", {}, 0.0),
    ("diagonal", {"contact": [[True, True]]}, 1.0),
    ("diagonal", {"contact": [[True, False]]}, 0.0),
    ("diagonal", {"contact": [[True, False, True, True]], "opposite": np.array([3, 2, 1, 0])}, 0.5),
    ("orientation", {"gravity": [[0.3, -0.4, -sqrt(0.75)]]}, 0.25),
    ("angular_motion", {"angular_velocity": [[0.3, 0.4, 7.0]]}, 0.25),
]


@pytest.mark.parametrize(("name", "changes", "expected"), CASES)
def test_term_has_the_value_of_the_table(name, changes, expected):
    value = rewards.TERMS[name].function(step(**changes))
    assert value.shape == (1,)
    assert value[0] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_every_term_is_tested_and_has_a_coefficient():
    assert {case[0] for case in CASES} == set(rewards.TERMS)
    named = {f.name for f in fields(RewardConfig)} - {"scale", "fall", "clearance_target"}
    assert named == set(rewards.TERMS)


def test_curriculum_multiplies_the_terms_the_tables_say():
    with_factor = {name for name, term in rewards.TERMS.items() if term.curriculum}
    assert with_factor == {
        "yaw",
        "torque",
        "torque_clip",
        "nominal_position",
        "joint_velocity",
        "joint_acceleration",
        "action_smoothness",
        "flight",
        "slip",
        "grf_smoothness",
        "action_clip",
        "joint_limit",
    }


def test_total_weighs_and_sums():
    zeros = {f.name: 0.0 for f in fields(RewardConfig)}
    config = RewardConfig(**{**zeros, "scale": 0.5, "command": 2.0, "torque": -0.01})
    total, means = rewards.total(step(torque_square=[[100.0, 25.0]]), config, curriculum=0.2)
    assert total[0] == pytest.approx(0.5 * (2.0 * 3.0 - 0.2 * 0.01 * 125.0))
    assert means == {"command": pytest.approx(3.0), "torque": pytest.approx(-0.125)}


def test_clearance_2_repeats_the_weighted_clearance_1():
    zeros = {f.name: 0.0 for f in fields(RewardConfig)}
    config = RewardConfig(**{**zeros, "scale": 1.0, "clearance_1": -3.0, "clearance_2": 2.0})
    total, _ = rewards.total(step(previous_clearance=[[0.2, 0.0]]), config, 1.0)
    assert total[0] == pytest.approx(2.0 * (-3.0 * 0.2))


def test_penalties_of_the_default_are_negative_and_rewards_positive():
    config = RewardConfig()
    gains = {"command", "base_height", "airtime", "tracking", "tracking_yaw", "gait_match", "clearance_2"}
    for name in rewards.TERMS:
        value = getattr(config, name)
        assert value >= 0.0 if name in gains else value <= 0.0, name
