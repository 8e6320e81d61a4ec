"""Ground contact: friction, who may touch, pushes."""

from __future__ import annotations

import mujoco
import numpy as np

from hqpipe.sim.engine import robot_setup
from hqpipe.sim.mujoco_model import robot_spec
from hqpipe.sim.pybullet_world import SPACING
from hqpipe.sim.randomisation import KinematicsRandomisation, robot_variants

MASS = 317.2  # kg, robot.urdf


def slide(world, robot, nominal, steps=40):
    """Nominal pose at 6 m/s, fast enough for the feet to slide; forces and foot velocities of every millisecond."""
    n = world.num_envs
    world.reset(np.arange(n), **nominal(n, base_linear_velocity=[6.0, 0.0, 0.0]))
    forces, speeds = [], []
    for _ in range(steps):
        world.step(np.tile(robot.nominal_position, (n, 1)))
        forces.append(world.state.foot_force.copy())
        speeds.append(world.state.foot_velocity[..., :2].copy())
    return np.array(forces), np.array(speeds)


def momentum(state, robot) -> np.ndarray:
    """(3,) linear momentum of the first robot, kg·m/s."""
    setup = robot_setup(robot)
    model = robot_spec(setup, setup.variants[0]).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate(
        (state.base_position[0], state.base_orientation[0, [3, 0, 1, 2]], state.joint_position[0])
    )
    data.qvel[:] = np.concatenate(
        (state.base_linear_velocity[0], state.base_angular_velocity[0], state.joint_velocity[0])
    )
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return MASS * data.subtree_linvel[0]


def test_friction_coefficient_measured_by_sliding(engine, make_world, robot, nominal):
    forces, speeds = slide(make_world(engine=engine, decimation=1), robot, nominal)
    sliding = (np.linalg.norm(speeds, axis=-1) > 1.0) & (forces[..., 2] > 200.0)
    assert sliding.sum() > 10
    ratio = np.linalg.norm(forces[..., :2], axis=-1)[sliding] / forces[..., 2][sliding]
    np.testing.assert_allclose(ratio, 0.8, rtol=0.02)
    assert (np.einsum("...i,...i", forces[..., :2], speeds)[sliding] < 0).all()


def test_foot_forces_and_weight_change_the_momentum(engine, make_world, robot, nominal):
    """Newton, over 40 ms of sliding and bouncing."""
    world = make_world(engine=engine, decimation=1)
    forces, _ = slide(world, robot, nominal)
    start = MASS * np.array([6.0, 0.0, 0.0])
    impulse = 1e-3 * (forces[:, 0].sum(axis=(0, 1)) - len(forces) * np.array([0.0, 0.0, MASS * 9.81]))
    assert np.abs(impulse[[0, 2]]).min() > 5.0
    np.testing.assert_allclose(momentum(world.state, robot) - start, impulse, atol=0.5)


def test_friction_can_be_randomised(engine, make_world, robot, nominal):
    """The largest ratio of tangential to normal force is the coefficient that was drawn."""
    off = {name: 0.0 for name in ("link_length", "frame_offset", "frame_angle", "mass", "com")}
    sizes = KinematicsRandomisation(variants=4, friction=0.5, **off)
    world = make_world(4, engine=engine, randomisation=sizes, decimation=1)
    forces, _ = slide(world, robot, nominal, steps=150)
    loaded = forces[..., 2] > 100.0
    ratio = np.linalg.norm(forces[..., :2], axis=-1) / np.where(loaded, forces[..., 2], np.inf)
    drawn = [variant.friction for variant in robot_variants(robot, sizes, seed=0)]
    np.testing.assert_allclose(ratio.max(axis=(0, 2)), drawn, rtol=0.03)
    assert np.ptp(drawn) > 0.2


def test_lying_on_the_back_is_illegal(engine, make_world, robot, nominal):
    world = make_world(2, engine=engine)
    back = nominal(1, base_position=[0.0, 0.0, 0.175], base_orientation=[1.0, 0.0, 0.0, 0.0])
    world.reset(np.array([1]), **back)
    for _ in range(20):
        state = world.step(np.tile(robot.nominal_position, (2, 1)))
    np.testing.assert_array_equal(state.illegal_contact, [False, True])


def test_kneeling_on_a_shank_is_allowed_and_on_a_thigh_is_not(engine, make_world, robot, nominal):
    """Shanks level with the ground, knees bent to 2 rad, then thighs level with the shanks up."""
    world = make_world(2, engine=engine)
    kneel = np.tile([0.0, 0.45, -2.0], 4)
    lifted = np.tile([0.0, 1.6, -0.15], 4)
    world.reset(np.array([0]), **nominal(1, joint_position=kneel, base_position=[0, 0, 0.50]))
    world.reset(np.array([1]), **nominal(1, joint_position=lifted, base_position=[0, 0, 0.24]))
    seen = np.zeros(2, dtype=bool)
    for _ in range(15):
        seen |= world.step(np.array([kneel, lifted])).illegal_contact
    np.testing.assert_array_equal(seen, [False, True])


def test_in_the_air_nothing_touches(engine, make_world, robot, nominal):
    world = make_world(engine=engine)
    world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 2.0]))
    state = world.step(robot.nominal_position[None])
    assert not state.foot_contact.any() and not state.foot_force.any() and not state.illegal_contact.any()


def test_robots_do_not_touch_each_other(engine, make_world, robot, nominal):
    """Eight robots whose places coincide in a pybullet world, where they start side by side, stand as one does."""
    world, start = make_world(8, engine=engine), nominal(8)
    start["base_position"][:, 1] = -SPACING * np.arange(8)
    world.reset(np.arange(8), **start)
    for _ in range(50):
        state = world.step(np.tile(robot.nominal_position, (8, 1)))
    place = state.base_position - start["base_position"]
    np.testing.assert_allclose(place, np.tile(place[:1], (8, 1)), atol=1e-9)


def test_a_push_changes_the_momentum_by_its_impulse(engine, make_world, robot, nominal):
    """In the air with stiff joints the robot moves as one body once the push is over."""
    world = make_world(2, engine=engine)
    half = np.sqrt(0.5)
    world.reset(np.arange(2), **nominal(2, base_position=[0, 0, 5.0], base_orientation=[0.0, 0.0, half, half]))
    impulse = np.array([[60.0, -40.0, 100.0]])
    world.apply_push(np.array([1]), impulse)
    for _ in range(20):
        state = world.step(np.tile(robot.nominal_position, (2, 1)))
    change = state.base_linear_velocity[1] - state.base_linear_velocity[0]
    np.testing.assert_allclose(change, impulse[0] / MASS, atol=0.03)
    again = world.step(np.tile(robot.nominal_position, (2, 1)))
    later = again.base_linear_velocity[1] - again.base_linear_velocity[0]
    np.testing.assert_allclose(later, change, atol=0.01)


def test_engines_push_alike(make_world, robot, nominal):
    changes = []
    for engine in ("pybullet", "mujoco"):
        world = make_world(engine=engine)
        world.reset(np.array([0]), **nominal(1, base_position=[0.0, 0.0, 5.0]))
        world.apply_push(np.array([0]), np.array([[80.0, 50.0, 20.0]]))
        state = world.step(robot.nominal_position[None])
        changes.append(np.concatenate((state.base_linear_velocity[0], state.base_angular_velocity[0])))
    np.testing.assert_allclose(*changes, atol=2e-3)
