"""The actuator model in the loop: order, record of the effort, parameters of one's own."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.hydraulic import Hydraulic
from hqpipe.actuators.ideal_torque import IdealTorque
from hqpipe.actuators.stiff_pd import StiffPD


@pytest.fixture
def hydraulic(robot):
    return Hydraulic.build(
        robot.joints,
        dt=0.001,
        k1=149_000.0,
        k2=0.05,
        k3=5_970.0,
        k4=0.0,
        sprocket_radius=robot.sprocket_radius,
        effort_limit=robot.effort_limit,
    )


def test_torque_comes_from_the_state_before_the_step(engine, make_world, robot, nominal):
    world = make_world(engine=engine, decimation=1)
    start = nominal(1, base_position=[0.0, 0.0, 3.0], joint_velocity=np.linspace(-1.0, 1.0, 12))
    world.reset(np.array([0]), **start)
    targets = robot.nominal_position + 0.02
    state = world.step(targets[None])
    expected = robot.stiff_pd.kp * 0.02 - robot.stiff_pd.kd * start["joint_velocity"][0]
    np.testing.assert_allclose(state.joint_effort[0], expected, rtol=1e-12)
    np.testing.assert_allclose(state.effort_mean_square[0], expected**2, rtol=1e-12)


def test_position_follows_the_new_velocity(engine, make_world, robot, nominal):
    """Semi-implicit Euler: q(t + dt) = q(t) + dt q̇(t + dt)."""
    world = make_world(engine=engine, decimation=1)
    world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 3.0]))
    state = world.step(robot.nominal_position[None] + 0.05)
    moved = state.joint_position[0] - robot.nominal_position
    np.testing.assert_allclose(moved, 1e-3 * state.joint_velocity[0], rtol=1e-9)
    assert np.abs(state.joint_velocity).max() > 0.1


def test_ten_steps_of_one_millisecond_are_one_policy_step(engine, make_world, robot, hydraulic):
    """Also the record: mean of the squares, largest excess."""
    targets = robot.nominal_position[None] + 0.4
    long, short = (make_world(1, hydraulic, engine=engine, decimation=d) for d in (10, 1))
    for _ in range(3):
        state = long.step(targets)
        squares, excess = [], []
        for _ in range(10):
            one = short.step(targets)
            squares.append(one.effort_mean_square[0].copy())
            excess.append(one.effort_clipped[0].copy())
        np.testing.assert_array_equal(state.joint_position, one.joint_position)
        np.testing.assert_array_equal(state.joint_effort, one.joint_effort)
        np.testing.assert_allclose(state.effort_mean_square[0], np.mean(squares, axis=0), rtol=1e-12)
        np.testing.assert_array_equal(state.effort_clipped[0], np.max(excess, axis=0))
    assert state.effort_clipped.max() > 0.0
    assert np.abs(state.joint_effort).max() <= robot.effort_limit.max()


def test_the_clipped_effort_is_the_excess_of_the_demand(engine, make_world, robot, nominal):
    weak = StiffPD.build(robot.joints, kp=1000.0, kd=0.0, effort_limit=40.0)
    world = make_world(1, weak, engine=engine, decimation=1)
    world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 3.0]))
    offset = np.zeros(12)
    offset[:3] = 0.1, -0.05, 0.03  # rad: demands of 100, −50 and 30 N·m
    state = world.step((robot.nominal_position + offset)[None])
    np.testing.assert_allclose(state.joint_effort[0, :4], [40.0, -40.0, 30.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(state.effort_clipped[0, :4], [60.0, 10.0, 0.0, 0.0], atol=1e-9)


def test_the_robot_limits_an_unlimited_actuator(engine, make_world, robot, nominal):
    free = IdealTorque.build(robot.joints, kp=1e5, kd=0.0, effort_limit=np.inf)
    world = make_world(1, free, engine=engine, decimation=1)
    world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 3.0]))
    state = world.step(robot.nominal_position[None] + 1.0)
    np.testing.assert_array_equal(state.joint_effort[0], robot.effort_limit)
    np.testing.assert_allclose(state.effort_clipped[0], 1e5 - robot.effort_limit)


def test_every_robot_may_have_an_actuator_of_its_own(engine, make_world, robot, stiff, snapshot):
    """Row by row the same as worlds in which all have that actuator."""
    soft = StiffPD.build(robot.joints, kp=3000.0, kd=100.0, effort_limit=500.0)
    mixed = make_world(2, engine=engine)
    mixed.set_actuator_parameters(np.array([1]), soft.parameters[None])
    hard_only, soft_only = make_world(2, engine=engine), make_world(2, soft, engine=engine)
    targets = np.tile(robot.nominal_position, (2, 1)) + 0.05
    for _ in range(10):
        states = [snapshot(world.step(targets)) for world in (mixed, hard_only, soft_only)]
    np.testing.assert_array_equal(states[0][0], states[1][0])
    np.testing.assert_array_equal(states[0][1], states[2][1])
    assert (states[0][0] != states[0][1]).any()


def test_an_effort_to_start_with(engine, make_world, nominal, hydraulic, robot):
    """The hydraulic model remembers its torque: (1 − k2) of it is left after a sample without error or motion."""
    world = make_world(1, hydraulic, engine=engine, decimation=1)
    world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 3.0]), joint_effort=np.full((1, 12), 100.0))
    np.testing.assert_allclose(world.step(robot.nominal_position[None]).joint_effort, 95.0)
