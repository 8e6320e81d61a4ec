"""The interface of the batched world: shapes, defaults and refusals."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.errors import UsageError
from hqpipe.sim import ENGINES
from hqpipe.sim.teams import split
from hqpipe.sim.world import BatchedWorld


def test_a_new_world_stands_in_the_nominal_pose(engine, make_world, robot):
    world = make_world(3, engine=engine)
    state = world.state
    assert {f.name: getattr(state, f.name).shape for f in fields(state)} == {
        "base_position": (3, 3),
        "base_orientation": (3, 4),
        "base_linear_velocity": (3, 3),
        "base_angular_velocity": (3, 3),
        "joint_position": (3, 12),
        "joint_velocity": (3, 12),
        "joint_effort": (3, 12),
        "actuator_memory": (3, 12, 0),
        "effort_mean_square": (3, 12),
        "effort_clipped": (3, 12),
        "foot_position": (3, 4, 3),
        "foot_velocity": (3, 4, 3),
        "foot_force": (3, 4, 3),
        "foot_contact": (3, 4),
        "illegal_contact": (3,),
    }
    np.testing.assert_array_equal(state.joint_position, np.tile(robot.nominal_position, (3, 1)))
    np.testing.assert_allclose(state.foot_position[..., 2], 0.05, atol=0.001)  # foot radius, robot.urdf
    left_front, right_front, left_hind, right_hind = state.foot_position[0]
    assert left_front[0] > 0 > left_hind[0] and right_front[0] > 0 > right_hind[0]
    assert left_front[1] > 0 > right_front[1] and left_hind[1] > 0 > right_hind[1]


def test_step_returns_the_state_it_updates_in_place(engine, make_world, robot):
    world = make_world(2, engine=engine)
    state = world.state
    before = state.base_position.copy()
    assert world.step(np.tile(robot.nominal_position, (2, 1))) is state
    assert (state.base_position != before).any()


def test_the_state_cannot_be_written(engine, make_world):
    with pytest.raises(ValueError, match="read-only"):
        make_world(engine=engine).state.joint_position[0, 0] = 1.0


def test_reset_imposes_exactly_the_given_state(engine, make_world, nominal):
    world = make_world(3, engine=engine)
    half = np.sqrt(0.5)
    wanted = nominal(
        1,
        base_position=[1.5, -2.5, 3.0],
        base_orientation=[0.0, 0.0, half, half],
        base_linear_velocity=[1.0, 2.0, 3.0],
        base_angular_velocity=[0.3, 0.2, 0.1],
        joint_velocity=np.linspace(-1.0, 1.0, 12),
    )
    world.reset(np.array([1]), **wanted)
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(world.state, name)[1], value[0], rtol=0, atol=1e-15)
    assert np.abs(world.state.base_position[[0, 2], :2]).max() == 0.0


def test_feet_turn_with_the_base(engine, make_world, nominal):
    world, half = make_world(2, engine=engine), np.sqrt(0.5)
    place = [4.0, 5.0, 2.0]
    world.reset(np.array([0]), **nominal(1, base_position=place))
    world.reset(np.array([1]), **nominal(1, base_position=place, base_orientation=[0.0, 0.0, half, half]))
    straight, turned = world.state.foot_position - place
    np.testing.assert_allclose(turned[:, 0], -straight[:, 1], atol=1e-9)
    np.testing.assert_allclose(turned[:, 1], straight[:, 0], atol=1e-9)


def test_foot_velocity_is_the_rate_of_foot_position(engine, make_world, nominal, robot):
    """Over one millisecond in the air, with the base turning and the joints moving."""
    world = make_world(engine=engine, decimation=1)
    rng = np.random.default_rng(0)
    start = nominal(
        1,
        base_position=[0.0, 0.0, 3.0],
        base_linear_velocity=rng.normal(size=3),
        base_angular_velocity=rng.normal(size=3),
        joint_velocity=rng.normal(size=12),
    )
    before = world.reset(np.array([0]), **start).foot_position.copy()
    state = world.step(robot.nominal_position[None])
    np.testing.assert_allclose((state.foot_position - before) / 1e-3, state.foot_velocity, atol=0.02)
    assert np.abs(state.foot_velocity).max() > 0.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda w, n: w.step(np.zeros((1, 12))), r"targets: expected shape \(2, 12\), got \(1, 12\)"),
        (lambda w, n: w.reset(np.array([2]), **n(1)), r"indices: expected 0 … 1, got 2 … 2"),
        (lambda w, n: w.reset(np.array([True, False]), **n(2)), "environment numbers"),
        (lambda w, n: w.reset(np.array([0]), **n(2)), r"base_position: expected shape \(1, 3\), got \(2, 3\)"),
        (lambda w, n: w.reset(np.array([0]), **n(1, base_orientation=[0, 0, 0, 2.0])), "unit quaternions"),
        (lambda w, n: w.apply_push(np.array([0]), np.zeros(3)), r"impulse: expected shape \(1, 3\)"),
        (lambda w, n: w.set_actuator_parameters(np.array([0]), np.zeros((12, 3))), r"\(1, 12, 3\)"),
    ],
)
def test_wrong_arguments_are_named(make_world, nominal, call, message):
    with pytest.raises(UsageError, match=message):
        call(make_world(2, engine="mujoco"), nominal)


def test_unknown_engine_names_the_near_match(make_world):
    with pytest.raises(UsageError, match="unknown physics engine 'mujocco' – did you mean 'mujoco'"):
        make_world(engine="mujocco")


@pytest.mark.parametrize("option", ["num_envs", "workers", "decimation"])
def test_counts_start_at_one(make_world, option):
    with pytest.raises(UsageError, match=f"{option} is 0, expected at least 1"):
        make_world(engine="mujoco", **{option: 0})


def test_an_actuator_for_another_rate_is_refused(make_world, robot):
    slow = Hydraulic.build(
        robot.joints, dt=0.002, k1=1e5, k2=0.1, k3=1e3, k4=0.0, sprocket_radius=0.06, effort_limit=900.0
    )
    with pytest.raises(UsageError, match=r"every 0.002 s"):
        make_world(1, slow, engine="mujoco")


def test_an_actuator_without_one_of_the_joints_is_refused(robot, stiff):
    with pytest.raises(UsageError, match="no joint 'RHK'"):
        BatchedWorld(robot, stiff.for_joints(robot.joints[:-1]), 1, engine="mujoco")


def test_a_closed_world_refuses_to_step(engine, make_world, robot):
    world = make_world(engine=engine)
    world.close()
    world.close()
    with pytest.raises(UsageError, match="closed"):
        world.step(robot.nominal_position[None])
    assert world.state.base_position.shape == (1, 3)


def test_every_engine_says_how_it_is_spread_over_workers():
    assert {ENGINES[name].PARALLEL for name in ENGINES} == {"processes", "threads"}
    assert all(ENGINES[name].BLOCK >= 1 for name in ENGINES)


@pytest.mark.parametrize(
    ("count", "block", "parts", "expected"),
    [
        (400, 8, 2, [(0, 200), (200, 400)]),
        (20, 8, 2, [(0, 8), (8, 20)]),
        (7, 8, 4, [(0, 7)]),
        (5, 1, 2, [(0, 2), (2, 5)]),
    ],
)
def test_rows_are_split_into_whole_blocks(count, block, parts, expected):
    assert split(count, block, parts) == expected
