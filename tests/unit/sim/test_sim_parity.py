"""The two engines agree on the same robot."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.stiff_pd import StiffPD
from hqpipe.robots import load_robot
from hqpipe.sim import ENGINES
from hqpipe.sim.randomisation import KinematicsRandomisation

WEIGHT = 317.2 * 9.81  # N, sum of the masses in robot.urdf


def test_free_fall(make_world, nominal, robot):
    """0.3 s of tumbling with limp joints."""
    limp = StiffPD.build(robot.joints, kp=0.0, kd=0.0, effort_limit=1.0)
    rng = np.random.default_rng(2)
    start = nominal(
        1,
        base_position=[0.0, 0.0, 5.0],
        base_angular_velocity=rng.uniform(-1.0, 1.0, 3),
        joint_velocity=rng.uniform(-0.5, 0.5, 12),
    )
    end = {}
    for engine in ENGINES:
        world = make_world(1, limp, engine=engine)
        world.reset(np.array([0]), **start)
        for _ in range(30):
            state = world.step(robot.nominal_position[None])
        end[engine] = (state.base_position[0], state.base_orientation[0], state.joint_position[0])
    for a, b in zip(*end.values(), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-4)
    fallen = 5.0 - 9.81 * 0.3**2 / 2
    assert abs(end["mujoco"][0][2] - fallen) < 0.1
    assert np.abs(end["mujoco"][2] - robot.nominal_position).max() > 0.05


def test_standing(make_world, robot):
    states = {}
    for engine in ENGINES:
        world = make_world(1, engine=engine)
        for _ in range(300):
            states[engine] = world.step(robot.nominal_position[None])
    for state in states.values():
        assert state.foot_contact.all() and not state.illegal_contact.any()
        np.testing.assert_allclose(state.foot_force[0].sum(axis=0), [0.0, 0.0, WEIGHT], atol=0.01 * WEIGHT)
    heights = [state.base_position[0, 2] for state in states.values()]
    assert abs(heights[0] - heights[1]) < 8e-4
    forces = [state.foot_force[0, :, 2] for state in states.values()]
    np.testing.assert_allclose(*forces, rtol=0.02)
    efforts = [state.joint_effort[0] for state in states.values()]
    np.testing.assert_allclose(*efforts, atol=8.0)


def test_trot(make_world, trot):
    """2.5 s of an open-loop trot over more than half a metre."""
    paths, joints = {}, {}
    for engine in ENGINES:
        world, path, pose = make_world(1, engine=engine), [], []
        for k in range(250):
            state = world.step(trot(0.01 * k)[None])
            path.append(state.base_position[0].copy())
            pose.append(state.joint_position[0].copy())
        paths[engine], joints[engine] = np.array(path), np.array(pose)
    assert paths["mujoco"][-1, 0] > 0.5
    np.testing.assert_allclose(*paths.values(), atol=0.015)
    np.testing.assert_allclose(*joints.values(), atol=0.01)


@pytest.mark.parametrize("seed", [0, 1])
def test_randomised_robots_have_the_same_feet(make_world, robot, seed):
    """Joint frames, turned and shifted, mean the same to both; so do shifted centres of mass, in free fall."""
    sizes = KinematicsRandomisation(variants=4, link_length=0.1, frame_offset=0.02, frame_angle=0.1, com=0.05)
    limp = StiffPD.build(robot.joints, kp=0.0, kd=0.0, effort_limit=1.0)
    states = {}
    for engine in ENGINES:
        world = make_world(4, limp, engine=engine, seed=seed, randomisation=sizes)
        start = world.state.foot_position.copy()
        lifted = np.tile([0.0, 0.0, 3.0], (4, 1))
        still, spin = np.zeros((4, 3)), np.tile([0.5, -0.3, 0.8], (4, 1))
        pose = np.tile(robot.nominal_position, (4, 1))
        world.reset(np.arange(4), lifted, np.tile([0.0, 0.0, 0.0, 1.0], (4, 1)), still, spin, pose, 0 * pose + 0.7)
        moving = world.state.foot_velocity.copy()
        for _ in range(10):
            state = world.step(pose)
        states[engine] = (start, moving, state.base_position, state.foot_position, state.foot_velocity)
    for a, b, tolerance in zip(*states.values(), (1e-9, 1e-9, 1e-4, 1e-4, 2e-3), strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance)
    assert np.ptp(states["mujoco"][0], axis=0).min() > 1e-3


def test_the_weight_is_that_of_the_urdf():
    text = load_robot("hydraulic_quadruped").urdf.read_text()
    masses = [float(part.split('"')[1]) for part in text.split("<mass ")[1:]]
    assert sum(masses) * 9.81 == pytest.approx(WEIGHT)
