"""The simulated robots of a training and of its evaluations."""

from __future__ import annotations

import numpy as np

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.actuators.base import ActuatorModel
from hqpipe.actuators.posterior import Posterior
from hqpipe.rl.actuator_draws import drawn_parameters
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
    robot: RobotSpec,
    actuator: ActuatorModel,
    config: TrainConfig,
    *,
    num_envs: int,
    workers: int,
    seed: int,
    posterior: Posterior | None = None,
    engine: str | None = None,
) -> BatchedWorld:
    """Robots that differ in kinematics, masses, ground friction and actuator coefficients.

    Args:
        engine: instead of that of the configuration. posterior: of the actuator's parameters, if it has one.
    """
    sizes = config.randomisation
    table = training_actuators(robot, actuator, config, num_envs=num_envs, seed=seed, posterior=posterior)
    world = BatchedWorld(
        robot,
        actuator,
        num_envs,
        engine=engine or config.engine,
        workers=workers,
        seed=seed,
        randomisation=_kinematics(sizes),
    )
    if table is not None:
        world.set_actuator_parameters(np.arange(num_envs), table)
    return world


def training_actuators(
    robot: RobotSpec,
    actuator: ActuatorModel,
    config: TrainConfig,
    *,
    num_envs: int,
    seed: int,
    posterior: Posterior | None = None,
) -> np.ndarray | None:
    """(num_envs, J, P) tables of the actuators in `training_world`; None where all have the model's own."""
    model = actuator.for_joints(robot.joints)
    return drawn_parameters(model, num_envs, config.randomisation.actuator, posterior, actuator_seed(seed))


def actuator_seed(seed: int) -> list[int]:
    """Of what `training_actuators` draws in a training with this seed."""
    return [seed, 1]


def evaluation_world(
    robot: RobotSpec, actuator: ActuatorModel, config: TrainConfig, *, workers: int, engine: str | None = None
) -> BatchedWorld:
    """Exact robots; engine: instead of that of the configuration."""
    return BatchedWorld(robot, actuator, config.evaluation.num_envs, engine=engine or config.engine, workers=workers)


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
