"""The two-chamber model in the training simulator."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators.loops.chamber_step import AWAKE, SUM
from hqpipe.actuators.two_chamber import TwoChamber


def test_robot_stands_on_its_oil(engine, make_world, nominal, robot):
    """Held at the nominal pose for half a second it carries its weight, and a reset forgets the pressures."""
    model = TwoChamber.build(
        robot.joints, dt=1e-3, full_torque=950.0, stiffness=2e4, flow_gain=25.0, valve_lag=0.0015, leakage=4.0,
        null_opening=0.0, volume_slope=0.3, coulomb_friction=0.0, viscous_friction=0.0, speed_limit=robot.velocity_limit,
        middle=0.5 * (robot.position_lower + robot.position_upper), sample_time=1e-3, effort_limit=robot.effort_limit,
    )  # fmt: skip
    world = make_world(2, model, engine=engine)
    world.reset(np.arange(2), **nominal(2))
    for _ in range(50):
        world.step(np.tile(robot.nominal_position, (2, 1)))
    assert (world.state.base_position[:, 2] > 0.8 * robot.nominal_height).all()
    memory = world.state.actuator_memory
    assert (memory[..., AWAKE] == 1.0).all() and np.abs(memory[..., SUM] - 1.0).max() < 0.5
    world.reset(np.array([0]), **nominal(1))
    assert not world.state.actuator_memory[0].any() and world.state.actuator_memory[1].any()
