"""Actuators of a training: drawn from the posterior of the fit, or within a half-range."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from hqpipe.actuators.augmented import Augmented
from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.posterior import Alternative, Choice, Group, Posterior, Range
from hqpipe.errors import ConfigError
from hqpipe.machine.layout import FIELDS, neutral_row
from hqpipe.rl.actuator_draws import drawn_parameters, draws_report, scattered_parameters
from hqpipe.rl.config import ActuatorRandomisationConfig, TrainConfig, from_mapping
from hqpipe.rl.train import train
from hqpipe.sim.world import BatchedWorld

SIZES = ActuatorRandomisationConfig()
K = np.array([1.0e5, 0.06, 3.8e3, 0.0])


def fitted(joints) -> tuple[Hydraulic, Posterior]:
    """A model of the paper, 5 % uncertain, whose k4 no log has shown."""
    columns = dict(zip(("k1", "k2", "k3", "k4"), K, strict=True))
    model = Hydraulic.build(joints, dt=1e-3, sprocket_radius=0.06, effort_limit=1000.0, **columns)
    scatter = np.diag((0.05 * K) ** 2)
    upper = np.array([np.inf, 1.0, np.inf, np.inf])
    groups = [
        Group((joint,), K, scatter, scatter, 4, np.zeros(4), upper, {"k4": Range(0.0, 3.0, "no impacts")})
        for joint in joints
    ]
    return model, Posterior("hydraulic", ("k1", "k2", "k3", "k4"), tuple(groups))


def test_auto_takes_the_posterior_where_there_is_one():
    model, posterior = fitted(("a", "b"))
    drawn = drawn_parameters(model, 400, SIZES, posterior, 1)
    assert drawn[..., 0].std() / K[0] == pytest.approx(0.05 * np.sqrt(2.0), rel=0.1)
    uniform = drawn_parameters(model, 400, SIZES, None, 1)
    assert np.abs(uniform[..., 0] / K[0] - 1.0).max() <= 0.2
    assert drawn_parameters(model, 400, replace(SIZES, mode="none"), posterior, 1) is None


def test_a_model_without_coefficients_is_the_same_in_every_robot():
    class Net(ActuatorModel):
        NAME, KIND = "net", 0
        FIELDS = {"effort_limit": ParameterField("N·m", may_be_infinite=True, certain=True)}

    model = Net.build(("a", "b"), effort_limit=np.inf)
    assert drawn_parameters(model, 4, SIZES, None, 1) is None
    assert draws_report(model, SIZES, None, None, 1)["mode"] == "none"


def test_scale_widens_and_zero_turns_it_off():
    model, posterior = fitted(("a",))
    wide = drawn_parameters(model, 400, replace(SIZES, scale=2.0), posterior, 1)
    assert wide[..., 0].std() / K[0] == pytest.approx(0.10 * np.sqrt(2.0), rel=0.1)
    assert drawn_parameters(model, 400, replace(SIZES, scale=0.0), posterior, 1) is None


def test_a_posterior_that_is_not_there_is_an_error():
    model, _ = fitted(("a",))
    with pytest.raises(ConfigError, match="no posterior.json beside it: run hqpipe fit-actuator"):
        drawn_parameters(model, 4, replace(SIZES, mode="posterior"), None, 1)


def test_settings_are_checked():
    with pytest.raises(ConfigError, match="mode: 'posteriors' – did you mean 'posterior'"):
        from_mapping(TrainConfig(), {"randomisation": {"actuator": {"mode": "posteriors"}}})
    with pytest.raises(ConfigError, match="scale: expected 0 to 100 .*got -1.0"):
        from_mapping(TrainConfig(), {"randomisation": {"actuator": {"scale": -1.0}}})


def test_report_says_what_was_drawn():
    model, posterior = fitted(("a", "b"))
    table = drawn_parameters(model, 400, SIZES, posterior, 1)
    report = draws_report(model, SIZES, posterior, table, 1)
    json.dumps(report, allow_nan=False)
    assert report["mode"] == "posterior" and report["robots"] == 400
    assert report["not_identified"]["a"]["k4"]["reason"] == "no impacts"
    k1 = report["joints"]["b"]["k1"]
    assert k1["model"] == K[0] and k1["low"] < 0.9 * K[0] < 1.1 * K[0] < k1["high"]
    assert "effort_limit" not in report["joints"]["b"]
    assert "alternatives" not in report and report["without_sections"] == []
    assert draws_report(model, SIZES, None, table, 1)["half_range"] == 0.2


def delayed(robot) -> tuple[Augmented, Posterior]:
    """A diagnosed model: a delay of the command in the first leg, or of the valve, and no cause in the others."""
    rows = np.tile(neutral_row(), (len(robot.joints), 1))
    rows[:, [FIELDS.index(("base", name)) for name in ("k1", "k2", "k3")]] = 540.0, 0.05, 21.6
    names = ("k1", "command_delay_delay_s", "valve_delay_delay_s")

    def groups(joints, *delays):
        mean = np.array([540.0, *delays])
        scatter = np.diag(np.array([20.0, 0.0005 * (delays[0] > 0.0), 0.0005 * (delays[1] > 0.0)]) ** 2)
        return tuple(Group((joint,), mean, scatter, None, 2, np.zeros(3), np.full(3, 1e3)) for joint in joints)

    leg, others = robot.joints[:3], robot.joints[3:]
    rows[:3, FIELDS.index(("command_delay", "delay_s"))] = 0.006
    laws = Alternative("as diagnosed", 0.6, groups(leg, 0.006, 0.0)), Alternative("valve", 0.4, groups(leg, 0.0, 0.005))
    model = Augmented(robot.joints, rows, 1e-3)
    return model, Posterior("augmented", names, groups(others, 0.0, 0.0), (Choice(laws),))


def test_report_counts_the_robots_with_each_alternative(robot):
    model, posterior = delayed(robot)
    table = drawn_parameters(model, 400, SIZES, posterior, [7, 1])
    report = draws_report(model, SIZES, posterior, table, [7, 1])
    json.dumps(report, allow_nan=False)
    (choice,) = report["alternatives"]
    assert choice["joints"] == list(robot.joints[:3])
    at = list(model.FIELDS).index("valve_delay_delay_s")
    counted = [each["robots"] for each in choice["drawn"]]
    assert counted == [int(np.sum(table[:, 0, at] == 0.0)), int(np.sum(table[:, 0, at] != 0.0))]
    assert 0.3 < counted[1] / 400 < 0.5 and [each["probability"] for each in choice["drawn"]] == [0.6, 0.4]
    assert list(report["joints"][robot.joints[0]]) == list(posterior.fields)
    assert report["without_sections"] == [], "two trials were compared"


def test_robots_with_other_effects_move_as_those_of_a_world_of_their_own(robot):
    model, posterior = delayed(robot)
    table = drawn_parameters(model, 6, SIZES, posterior, 3)
    at = list(model.FIELDS).index("valve_delay_delay_s")
    assert len(set(table[:, 0, at] != 0.0)) == 2, "both delays are there"

    def efforts(world):
        targets = np.tile(robot.nominal_position, (world.num_envs, 1)) + 0.05
        return np.array([world.step(targets).joint_effort.copy() for _ in range(3)])

    mixed = BatchedWorld(robot, model, 6, engine="mujoco", workers=1, seed=0)
    mixed.set_actuator_parameters(np.arange(6), table)
    together = efforts(mixed)
    for k in range(6):
        own = replace(model, parameters=table[k])
        np.testing.assert_array_equal(
            efforts(BatchedWorld(robot, own, 6, engine="mujoco", workers=1, seed=0))[:, k], together[:, k]
        )
    assert (together[:, 0] != together[:, 1]).any()


def test_training_steps_the_drawn_actuators(robot, small):
    model, posterior = fitted(robot.joints)
    drawn, plain = (train(robot, model, small, workers=1, posterior=p) for p in (posterior, None))
    assert drawn.actuators["mode"] == "posterior" and plain.actuators["mode"] == "half_range"
    assert drawn.actuators["robots"] == small.num_envs
    assert drawn.rows != plain.rows


def test_scatter_keeps_geometry_and_bounds(actuator):
    table = scattered_parameters(actuator, 50, 0.2, np.random.default_rng(0))
    relative = table / actuator.parameters
    kp, limit = relative[..., 0], relative[..., list(actuator.FIELDS).index("effort_limit")]
    assert kp.min() >= 0.8 and kp.max() <= 1.2 and kp.std() > 0.1
    assert (limit == 1.0).all()


def test_scatter_leaves_what_is_certain_and_shares_what_is_shared():
    class Wide(ActuatorModel):
        NAME, KIND = "wide", 0
        FIELDS = {
            "kp": ParameterField("N·m/rad"),
            "middle": ParameterField("rad", lower=-np.inf, certain=True),
            "kd": ParameterField("N·m·s/rad"),
            "droop": ParameterField("s/rad", shared=True),
            "effort_limit": ParameterField("N·m", may_be_infinite=True, certain=True),
        }

    model = Wide.build(("a", "b"), kp=100.0, middle=-0.3, kd=5.0, droop=0.1, effort_limit=np.inf)
    table = scattered_parameters(model, 50, 0.2, np.random.default_rng(0))
    kp, middle, kd, droop, limit = np.moveaxis(table, -1, 0)
    for scattered, centre in ((kp, 100.0), (kd, 5.0)):
        assert (np.abs(scattered / centre - 1.0) <= 0.2).all() and len(np.unique(scattered)) == 100
    assert (middle == -0.3).all() and np.isinf(limit).all()
    np.testing.assert_array_equal(droop[:, 0], droop[:, 1])
    assert len(np.unique(droop)) == 50
