"""Load a floor and robots into a pybullet world."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hqpipe.errors import ConfigError
from hqpipe.sim.engine import GRAVITY, PHYSICS_DT, EngineSetup
from hqpipe.sim.quiet import STDERR, STDOUT, quiet

with quiet(STDOUT, STDERR):  # importing it prints its build time
    import pybullet

FLOOR_GROUP, ROBOT_GROUP = 1, 2  # bits of the collision masks


@dataclass(frozen=True)
class LoadedRobot:
    """Where pybullet keeps the parts of a robot.

    Attributes:
        body: unique id.
        joints, feet: link indices in the order of EngineSetup.
        links: every link index, −1 is the base.
        foot_of_link: link index → position in `feet`.
        allowed_links: feet and shanks.
        inertial: (7,) inertial frame of the base in its link frame, quaternion last.
        foot_inertial: (F, 7) the same of the feet.
    """

    body: int
    joints: tuple[int, ...]
    feet: tuple[int, ...]
    links: tuple[int, ...]
    foot_of_link: dict[int, int]
    allowed_links: frozenset[int]
    inertial: np.ndarray
    foot_inertial: np.ndarray


def open_world() -> tuple[int, int]:
    """Make an empty world with a floor at z = 0; returns its client number and the body of the floor."""
    client = pybullet.connect(pybullet.DIRECT)
    if client < 0:
        raise ConfigError("pybullet: no free client; use fewer environments or more workers")
    pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=client)
    pybullet.setTimeStep(PHYSICS_DT, physicsClientId=client)
    # Contacts in the order of the bodies, not of their making: a robot must not depend on its neighbours' past.
    pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    floor = pybullet.createMultiBody(0.0, plane, physicsClientId=client)
    # pybullet multiplies the coefficients of the two bodies; the robot's is the effective one.
    pybullet.changeDynamics(floor, -1, lateralFriction=1.0, physicsClientId=client)
    pybullet.setCollisionFilterGroupMask(floor, -1, FLOOR_GROUP, ROBOT_GROUP, physicsClientId=client)
    return client, floor


def load_robot_into(
    client: int, setup: EngineSetup, urdf: Path, friction: float, position: tuple[float, float, float]
) -> LoadedRobot:
    """Put one robot into the world with free joints and without damping.

    Raises:
        ConfigError: the URDF cannot be read or lacks a joint or link of `setup`.
    """
    try:
        with quiet(STDOUT):
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            body = pybullet.loadURDF(str(urdf), position, flags=flags, physicsClientId=client)
    except pybullet.error as error:
        raise ConfigError(
            "robot.urdf: pybullet cannot read it, expected one tree of links and joints",
            file="robot.urdf",
            fix="open it in a viewer of URDF files and correct what that names, or set engine to mujoco",
        ) from error
    robot = _parts(client, body, setup)
    for link in robot.links:
        pybullet.changeDynamics(
            body,
            link,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
            lateralFriction=friction,
            physicsClientId=client,
        )
    pybullet.setJointMotorControlArray(
        body,
        robot.joints,
        pybullet.VELOCITY_CONTROL,
        forces=[0.0] * len(robot.joints),
        physicsClientId=client,
    )
    renew_collisions(client, robot)
    return robot


def renew_collisions(client: int, robot: LoadedRobot) -> None:
    """Let the robot collide with the floor only, and forget its contacts with their impulses.

    Setting the mask of a link takes it out of the broad phase and puts it back, which drops its cached contacts.
    """
    for link in robot.links:
        pybullet.setCollisionFilterGroupMask(robot.body, link, ROBOT_GROUP, FLOOR_GROUP, physicsClientId=client)


def _parts(client: int, body: int, setup: EngineSetup) -> LoadedRobot:
    count = pybullet.getNumJoints(body, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, index, physicsClientId=client) for index in range(count)]
    joints = {info[1].decode(): info[0] for info in infos}
    links = {info[12].decode(): info[0] for info in infos}
    for kind, names, table in (
        ("joint", setup.joints, joints),
        ("link", setup.foot_links + setup.shank_links, links),
    ):
        for name in names:
            if name not in table:
                raise ConfigError(
                    f"robot.urdf: no {kind} '{name}', expected one of {', '.join(table)}",
                    file="robot.urdf",
                    field=name,
                    fix="correct the name in robot.yaml or robot.urdf",
                )
    base = pybullet.getBodyInfo(body, physicsClientId=client)[0].decode()
    if base != setup.base_link:
        raise ConfigError(
            f"robot.urdf: the root link is '{base}', expected base_link '{setup.base_link}'",
            file="robot.yaml",
            field="base_link",
            fix=f"write base_link: {base}",
        )
    feet = tuple(links[name] for name in setup.foot_links)
    return LoadedRobot(
        body=body,
        joints=tuple(joints[name] for name in setup.joints),
        feet=feet,
        links=(-1, *range(count)),
        foot_of_link={link: number for number, link in enumerate(feet)},
        allowed_links=frozenset((*feet, *(links[name] for name in setup.shank_links))),
        inertial=_inertial_frame(client, body, -1),
        foot_inertial=np.array([_inertial_frame(client, body, foot) for foot in feet]),
    )


def _inertial_frame(client: int, body: int, link: int) -> np.ndarray:
    dynamics = pybullet.getDynamicsInfo(body, link, physicsClientId=client)
    return np.array((*dynamics[3], *dynamics[4]))
