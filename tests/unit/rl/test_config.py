from __future__ import annotations

import json

import pytest

from hqpipe.errors import ConfigError
from hqpipe.rl.config import CurriculumConfig, TrainConfig, from_mapping, to_mapping
from hqpipe.rl.curriculum import curriculum_factor


def test_mapping_replaces_nested_fields_only():
    config = from_mapping(TrainConfig(), {"reward": {"torque": -1.0e-6}, "num_envs": 200})
    assert config.reward.torque == -1e-6
    assert config.num_envs == 200
    assert config.reward.command == TrainConfig().reward.command


def test_mapping_survives_json():
    config = from_mapping(TrainConfig(), {"command": {"vx": [0.0, 0.5]}, "policy": {"hidden": [32]}})
    again = from_mapping(TrainConfig(), json.loads(json.dumps(to_mapping(config))))
    assert again == config


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ({"reward": {"torqe": 1.0}}, r"unknown field 'reward\.torqe' – did you mean 'torque'"),
        ({"num_envs": 1.5}, "num_envs: expected a whole number"),
        ({"engine": 3}, "engine: expected text"),
        ({"policy": {"symmetric": 1}}, "policy.symmetric: expected true or false"),
        ({"policy": {"leg_odometry": "yes"}}, "policy.leg_odometry: expected true or false"),
        ({"ppo": 3}, "ppo: expected a mapping"),
        ({"gait": {"prior": "trot"}}, "gait.prior: 'trot'"),
        ({"ppo": {"batch_size": 7}}, "ppo.batch_size: 7 does not divide"),
        (
            {"command": {"straight_share": 0.6, "in_place_share": 0.5}},
            "command.in_place_share add up to 1.1, expected at most 1",
        ),
        ({"command": {"vx": [-0.2, 0.2], "smallest": 0.15}}, "command.vx reaches 0.2, expected 2 × command.smallest"),
        (
            {"command": {"vy": [0.0, 0.0], "in_place_share": 0.1, "smallest": 0.1}},
            "command.vy reaches 0, expected 2 × command.smallest",
        ),
        ({"evaluation": {"num_envs": 5}}, "evaluation.num_envs: 5"),
        ({"first_engine": "ode"}, "first_engine: 'ode', expected one of"),
        ({"first_share": 1.0}, "first_share: expected 0 to 0.95"),
        ({"first_share": 0.1}, r"first_share of 104 iterations is 10.4, expected checkpoint_interval or more \(50\)"),
    ],
)
def test_errors_name_the_field(raw, message):
    with pytest.raises(ConfigError, match=message):
        from_mapping(TrainConfig(), raw)


def test_curriculum_rises_linearly_to_one():
    config = CurriculumConfig(start=0.2, iterations=10)
    assert [curriculum_factor(config, i) for i in (0, 5, 10, 99)] == pytest.approx([0.2, 0.6, 1.0, 1.0])
