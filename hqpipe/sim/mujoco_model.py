"""Compile the training simulator's robot for MuJoCo: a free base, a floor, and the same friction as in pybullet."""

from __future__ import annotations

import mujoco

from hqpipe.errors import ConfigError
from hqpipe.sim.engine import GRAVITY, PHYSICS_DT, EngineSetup, RobotVariant
from hqpipe.sim.mujoco_refusal import named

# Stiff contacts, so that feet sink in and creep as little as pybullet's do. Assumptions, checked by the tests of engine
# parity: recover from penetration within 2.5 ms (MuJoCo allows two steps or more), friction ten times stiffer.
CONTACT_TIME_S = 0.0025
CONTACT_DAMPING_RATIO = 1.0
FRICTION_IMPEDANCE_RATIO = 10.0
SLIDING_ONLY = 3  # dimension of a contact without torsional and rolling friction
_FIX = "correct what it names, or lower randomisation.kinematics"


def robot_model(setup: EngineSetup, variant: RobotVariant) -> mujoco.MjModel:
    """The compiled robot on its floor.

    Raises:
        ConfigError: MuJoCo refuses the URDF, or a link or joint that the setup names is not in it.
    """
    spec = robot_spec(setup, variant)
    with named("robot.urdf", _FIX):
        return spec.compile()


def robot_spec(setup: EngineSetup, variant: RobotVariant) -> mujoco.MjSpec:
    """The robot on its floor; joints, links and the free joint "base" keep their names.

    A bare URDF welds its root to the world and drops the root's mass; hence the free joint.

    Raises:
        ConfigError: MuJoCo refuses the URDF, or a link or joint that the setup names is not in it.
    """
    with named("robot.urdf", _FIX):
        spec = mujoco.MjSpec.from_string(variant.urdf)
    spec.compiler.fusestatic = False  # fusing would merge the feet into the shanks
    _check_names(spec, setup)
    spec.option.timestep, spec.option.gravity = PHYSICS_DT, [0.0, 0.0, -GRAVITY]
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, FRICTION_IMPEDANCE_RATIO
    # A diverged robot must show as such, not start again unasked.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for geom in spec.geoms:  # collide with the floor only
        geom.contype, geom.conaffinity = 0, 1
        geom.friction[0] = variant.friction
    spec.body(setup.base_link).add_freejoint(name="base")
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    floor.contype, floor.conaffinity = 1, 0
    floor.friction[0] = 0.0  # MuJoCo takes the larger coefficient of the two
    for geom in spec.geoms:
        geom.condim, geom.solref = SLIDING_ONLY, [CONTACT_TIME_S, CONTACT_DAMPING_RATIO]
    return spec


def _check_names(spec: mujoco.MjSpec, setup: EngineSetup) -> None:
    joints, links = [joint.name for joint in spec.joints], [body.name for body in spec.bodies]
    for kind, wanted, known in (
        ("joint", setup.joints, joints),
        ("link", (setup.base_link, *setup.foot_links, *setup.shank_links), links),
    ):
        for name in wanted:
            if name not in known:
                raise ConfigError(
                    f"robot.urdf: no {kind} '{name}', expected one of {', '.join(known)}",
                    file="robot.urdf",
                    field=name,
                    fix="correct the name in robot.yaml or robot.urdf",
                )
