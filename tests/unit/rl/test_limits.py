"""No number of a training reaches the simulator that cannot work there."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass

import pytest

from hqpipe.errors import ConfigError
from hqpipe.rl.config import TrainConfig, from_mapping
from hqpipe.rl.limits import LAYERS, LIMITS, UNITS


def numbers(config, above: str = ""):
    for entry in fields(config):
        value, name = getattr(config, entry.name), f"{above}{entry.name}"
        if is_dataclass(value):
            yield from numbers(value, f"{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield name, value


NUMBERS = dict(numbers(TrainConfig()))


def nested(name: str, value) -> dict:
    for key in reversed(name.split(".")):
        value = {key: value}
    return value


def test_every_number_has_a_limit_that_holds_the_default():
    rewards = {name for name in NUMBERS if name.startswith("reward.")}
    assert set(LIMITS) <= set(NUMBERS) and set(NUMBERS) - rewards <= set(LIMITS)
    for name, limit in LIMITS.items():
        assert limit.lower <= NUMBERS[name] <= limit.upper and limit.reason


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, 1e300, -1e300, 10**400, True, "1", None, [1]], ids=lambda value: str(value)[:9]
)
def test_no_number_may_be_this(value):
    for name in NUMBERS:
        with pytest.raises(ConfigError) as caught:
            from_mapping(TrainConfig(), nested(name, value))
        assert caught.value.field == name and caught.value.fix and str(caught.value).startswith(f"{name}: ")
        assert len(str(caught.value)) < 400


def test_a_count_is_at_least_one():
    for name in [name for name, limit in LIMITS.items() if limit.lower == 1]:
        with pytest.raises(ConfigError, match=f"{name}: expected 1 to"):
            from_mapping(TrainConfig(), nested(name, 0))


@pytest.mark.parametrize(
    ("raw", "field"),
    [
        ({"command": {"vx": [0]}}, "command.vx"),
        ({"command": {"vx": [1.0, 0.0]}}, "command.vx"),
        ({"command": {"vy": ["a", "b"]}}, "command.vy"),
        ({"command": {"wz": [0.0, float("nan")]}}, "command.wz"),
        ({"command": {"wz": []}}, "command.wz"),
        ({"policy": {"hidden": []}}, "policy.hidden"),
        ({"policy": {"hidden": [10**9, 10**9]}}, "policy.hidden"),
        ({"policy": {"hidden": [1e9, 1e9]}}, "policy.hidden"),
        ({"policy": {"hidden": [True]}}, "policy.hidden"),
        ({"policy": {"hidden": [UNITS + 1]}}, "policy.hidden"),
        ({"policy": {"hidden": [8] * (LAYERS + 1)}}, "policy.hidden"),
        ({"evaluation": {"commands": []}}, "evaluation.commands"),
        ({"evaluation": {"commands": [[1.0, 0.0]]}}, "evaluation.commands"),
        ({"evaluation": {"commands": [1.0, 0.0, 0.0]}}, "evaluation.commands"),
        ({"evaluation": {"commands": [[1.0, 0.0, 1e300]]}}, "evaluation.commands"),
        ({"engine": "foo"}, "engine"),
        ({"engine": "x" * 10_000}, "engine"),
        ({"num_envs": 10**4, "ppo": {"n_steps": 10**4}}, "num_envs"),
    ],
)
def test_what_else_could_not_work(raw, field):
    with pytest.raises(ConfigError) as caught:
        from_mapping(TrainConfig(), raw)
    assert caught.value.field == field and caught.value.fix and len(str(caught.value)) < 400
