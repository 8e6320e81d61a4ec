"""What an actuator model remembers besides its torque: allocated, stepped, shared with the workers, forgotten on reset."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from hqpipe.actuators.base import ActuatorModel, ParameterField
from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.loops.actuator_step import AUGMENTED, PD
from hqpipe.machine.chain import loops
from hqpipe.machine.layout import FIELDS, neutral_row
from hqpipe.sim.state import ArraySizes

sys.path.insert(0, str(Path(__file__).parents[1] / "actuators"))
from net_examples import random_net

COLUMNS, RADIUS = 3, 0.06
LIMIT = ("setting", "effort_limit")


class Remembering(ActuatorModel):
    """A PD law whose class asks for memory that its kind leaves alone."""

    NAME, KIND, MEMORY = "remembering", PD, COLUMNS
    FIELDS = {
        "kp": ParameterField("N·m/rad"),
        "kd": ParameterField("N·m·s/rad"),
        "effort_limit": ParameterField("N·m", lower=1e-9, may_be_infinite=True),
    }


@pytest.fixture(scope="module")
def remembering(robot):
    return Remembering.build(robot.joints, kp=6000.0, kd=200.0, effort_limit=900.0)


def test_every_row_has_its_own_memory(engine, make_world, remembering, robot):
    world = make_world(3, remembering, engine=engine)
    assert world.state.actuator_memory.shape == (3, 12, COLUMNS)
    assert not world.state.actuator_memory.any() and not world.state.actuator_memory.flags.writeable
    world._arrays.state.actuator_memory[:] = np.arange(3 * 12 * COLUMNS).reshape(3, 12, COLUMNS)
    before = world.state.actuator_memory.copy()
    world.step(np.tile(robot.nominal_position, (3, 1)))
    np.testing.assert_array_equal(world.state.actuator_memory, before)


@pytest.mark.parametrize("how", ["reset", "new parameters"])
def test_a_robot_forgets_and_the_others_do_not(engine, make_world, remembering, nominal, how):
    world = make_world(3, remembering, engine=engine)
    world._arrays.state.actuator_memory[:] = 7.0
    if how == "reset":
        world.reset(np.array([1]), **nominal(1))
    else:
        world.set_actuator_parameters(np.array([1]), remembering.parameters[None])
    assert not world.state.actuator_memory[1].any()
    assert (world.state.actuator_memory[[0, 2]] == 7.0).all()


def test_memory_of_no_columns_changes_no_other_array():
    with_memory, without = (ArraySizes(5, 12, 6, 4, m) for m in (COLUMNS, 0))
    assert with_memory.nbytes() - without.nbytes() == -(-5 * 12 * COLUMNS * 8 // 64) * 64
    arrays = with_memory.arrays(bytearray(with_memory.nbytes()))
    arrays.rows(2, 4).state.actuator_memory[:] = 1.0
    np.testing.assert_array_equal(arrays.state.actuator_memory.any(axis=(1, 2)), [0, 0, 1, 1, 0])
    for name in ("joint_effort", "effort_mean_square"):
        assert not getattr(arrays.state, name).any()


class WithEffects(ActuatorModel):
    """Rows of `hqpipe.machine.layout` under their own names; the engines must not care what the columns are called."""

    NAME, KIND, MEMORY = "with_effects", AUGMENTED, loops().memory
    FIELDS = {
        "effort_limit" if key == LIMIT else "_".join(key): ParameterField("1", lower=-np.inf, may_be_infinite=True)
        for key in FIELDS
    }


GAINS = {"k1": 149_000.0, "k2": 0.05, "k3": 5_970.0, "k4": 1.0}
EFFECTS = {
    ("command_delay", "delay_s"): 0.0065,
    ("valve_lag", "time_constant_s"): 0.004,
    ("integral_action", "ki"): 2.0,
    ("supply_droop", "droop"): 0.02,
    ("backlash", "gap"): 0.004,
    ("coulomb_friction", "friction_nm"): 15.0,
}


@pytest.fixture(scope="module")
def hydraulic(robot):
    return Hydraulic.build(robot.joints, dt=0.001, sprocket_radius=RADIUS, effort_limit=900.0, **GAINS)


def with_effects(robot, effects):
    row = neutral_row()
    joint_space = {"k1": RADIUS**2, "k2": 1.0, "k3": RADIUS**2, "k4": RADIUS}
    values = {("base", name): GAINS[name] * scale for name, scale in joint_space.items()}
    for key, value in {**values, LIMIT: 900.0, **effects}.items():
        row[FIELDS.index(key)] = value
    return WithEffects(robot.joints, np.tile(row, (12, 1)), 0.001)


@pytest.fixture
def walked(engine, make_world, robot, nominal):
    """(T, N, J) torque under random targets, a reset half way; with `check`, held against `step` on the same inputs."""

    def walk(model, size, *, check=False, workers=1, count=3):
        world, rng = make_world(count, model, engine=engine, decimation=1, workers=workers), np.random.default_rng(0)
        tau, memory, history = np.zeros((count, 12)), model.fresh_memory(count), []
        for k in range(80):
            if k == 40:
                world.reset(np.array([1]), **nominal(1))
                tau[1] = memory[1] = 0.0
            if k % 10 == 0:
                targets = robot.nominal_position + rng.uniform(-size, size, (count, 12))
            q, qd = world.state.joint_position.copy(), world.state.joint_velocity.copy()
            state = world.step(targets)
            if check:
                model.step(tau, memory, targets, q, qd, 0.001)
                np.testing.assert_allclose(state.joint_effort, tau, rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(state.actuator_memory, memory, rtol=1e-9, atol=1e-9)
            history.append(state.joint_effort.copy())
        return np.array(history)

    return walk


def test_the_world_and_the_model_step_alike(walked, robot, hydraulic):
    """The torque of every millisecond, and what is remembered, are what `step` makes of the same inputs."""
    plain = walked(hydraulic, 0.04, check=True)
    rich = walked(with_effects(robot, EFFECTS), 0.04, check=True)
    assert np.abs(plain).max() < 900.0 and np.abs(rich - plain).max() > 20.0


def test_without_an_effect_it_is_the_paper_s_model_even_at_the_limit(walked, robot, hydraulic):
    """A torque that the robot's limit cut off does not wind up behind it."""
    paper, neutral = walked(hydraulic, 0.3), walked(with_effects(robot, {}), 0.3)
    assert (np.abs(paper) == 900.0).any()
    np.testing.assert_allclose(neutral, paper, rtol=1e-6, atol=1e-6)


def test_workers_share_the_memory(walked, robot):
    model = with_effects(robot, EFFECTS)
    np.testing.assert_array_equal(*(walked(model, 0.3, workers=workers, count=16) for workers in (1, 2)))


NETS = [("mlp", {}), ("mlp", {"taps": (0, 10, 20), "delta": True}), ("lstm", {}), ("gru", {"delta": True})]


@pytest.mark.parametrize(("kind", "options"), NETS)
def test_the_world_steps_a_net(walked, robot, kind, options):
    """Joints by name, memory, and its loss at a reset: what `step` makes of the same inputs."""
    model = random_net(kind, tuple(reversed(robot.joints)), size=0.3, **options)
    torque = walked(model.for_joints(robot.joints), 0.1, check=True)
    np.testing.assert_array_equal(walked(model, 0.1), torque)
    assert 1.0 < np.abs(torque).max() < robot.effort_limit.min()


def test_the_robot_s_effort_limit_holds_for_a_net(walked, robot):
    torque = walked(random_net("gru", robot.joints, size=100.0), 0.1)
    assert (np.abs(torque) == robot.effort_limit).any() and (np.abs(torque) <= robot.effort_limit).all()


def test_workers_share_the_weights(walked, robot):
    model = random_net("lstm", robot.joints)
    np.testing.assert_array_equal(*(walked(model, 0.3, workers=workers, count=16) for workers in (1, 2)))


def test_weights_lie_in_memory_once():
    sizes, wide = ArraySizes(5, 12, 1, 4, 0, 1000), ArraySizes(500, 12, 1, 4, 0, 1000)
    for size in (sizes, wide):
        assert size.nbytes() - ArraySizes(size.envs, 12, 1, 4, 0).nbytes() == -(-4000 // 64) * 64
    arrays = sizes.arrays(bytearray(sizes.nbytes()))
    arrays.weights[:] = 3.0
    assert (arrays.rows(2, 4).weights == 3.0).all() and np.shares_memory(arrays.rows(2, 4).weights, arrays.weights)
