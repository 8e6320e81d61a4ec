"""The simulated robots of a training and of its evaluations."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.base import ActuatorModel
from hqpipe.rl.config import RandomisationConfig, TrainConfig
from hqpipe.robots import RobotSpec
from hqpipe.sim.randomisation import KinematicsRandomisation
from hqpipe.sim.world import BatchedWorld


def unmodelled_actuator(robot: RobotSpec, control_mode: str) -> ActuatorModel:
    """The actuator of the bootstrap: ideal torque in torque control, stiff PD in position control."""
    torque = control_mode == "torque"
    gains = robot.torque_pd if torque else robot.stiff_pd
    model = ACTUATOR_MODELS["ideal_torque" if torque else "stiff_pd"]
    return model.build(robot.joints, kp=gains.kp, kd=gains.kd, effort_limit=robot.effort_limit)


def training_world(
    robot: RobotSpec, actuator: ActuatorModel, config: TrainConfig, *, num_envs: int, workers: int, seed: int
) -> BatchedWorld:
    """Robots that differ in kinematics, masses, ground friction and actuator coefficients."""
    sizes = config.randomisation
    world = BatchedWorld(
        robot,
        actuator,
        num_envs,
        engine=config.engine,
        workers=workers,
        seed=seed,
        randomisation=_kinematics(sizes),
    )
    if sizes.actuator > 0.0:
        rng = np.random.default_rng([seed, 1])
        table = scattered_parameters(world.actuator, num_envs, sizes.actuator, rng)
        world.set_actuator_parameters(np.arange(num_envs), table)
    return world


def evaluation_world(robot: RobotSpec, actuator: ActuatorModel, config: TrainConfig, *, workers: int) -> BatchedWorld:
    """Exact robots."""
    return BatchedWorld(robot, actuator, config.evaluation.num_envs, engine=config.engine, workers=workers)


def scattered_parameters(
    actuator: ActuatorModel, count: int, half_range: float, rng: np.random.Generator
) -> np.ndarray:
    """(count, J, P) coefficients, each scaled by its own factor within 1 ± half_range and kept within its bounds.

    Certain columns, as geometry and limits, stay; a shared column has one factor per robot.
    """
    joints, fields = actuator.parameters.shape
    factor = rng.uniform(1.0 - half_range, 1.0 + half_range, size=(count, joints, fields))
    for column, field in enumerate(actuator.FIELDS.values()):
        if field.certain:
            factor[..., column] = 1.0
        elif field.shared:
            factor[..., column] = factor[:, :1, column]
    lower = [field.lower for field in actuator.FIELDS.values()]
    upper = [field.upper for field in actuator.FIELDS.values()]
    return np.clip(actuator.parameters * factor, lower, upper)


def _kinematics(sizes: RandomisationConfig) -> KinematicsRandomisation | None:
    if sizes.kinematics <= 0.0 and sizes.friction <= 0.0:
        return None
    usual, k = KinematicsRandomisation(), sizes.kinematics
    return KinematicsRandomisation(
        variants=usual.variants,
        link_length=k * usual.link_length,
        frame_offset=k * usual.frame_offset,
        frame_angle=k * usual.frame_angle,
        mass=k * usual.mass,
        com=k * usual.com,
        friction=sizes.friction,
    )
