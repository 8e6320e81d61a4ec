"""One pybullet world: a floor and up to eight robots, with the actuator model in the loop."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from hqpipe.sim.actuation import actuate
from hqpipe.sim.engine import PHYSICS_DT, EngineSetup
from hqpipe.sim.frames import base_from_com, com_from_base, foot_from_com
from hqpipe.sim.pybullet_robot import load_robot_into, open_world, pybullet, renew_collisions
from hqpipe.sim.state import WorldArrays

ROBOTS_PER_WORLD = 8  # a world takes about 40 MB, mostly fixed; more robots in one step no faster
SPACING = 4.0  # m between robots along y: overlapping boxes cost the broad phase 20 % of the step


class PybulletWorld:
    """Steps the robots of `arrays`, whose first row is environment number `first`; `urdfs` are the variants' files.

    The robots stand side by side; WorldState has each at its own origin.
    """

    def __init__(self, setup: EngineSetup, urdfs: Sequence[Path], arrays: WorldArrays, first: int) -> None:
        self.setup, self.arrays = setup, arrays
        count = len(arrays.reset_flag)
        self._client, self._floor = open_world()
        self._origin = np.zeros((count, 3))
        self._origin[:, 1] = SPACING * np.arange(count)
        self._robots = []
        for n in range(count):
            number = (first + n) % len(setup.variants)
            friction, place = setup.variants[number].friction, tuple(self._origin[n])
            self._robots.append(load_robot_into(self._client, setup, urdfs[number], friction, place))
        self._row = {robot.body: n for n, robot in enumerate(self._robots)}
        self._inertial = np.array([robot.inertial for robot in self._robots])
        self._foot_inertial = np.array([robot.foot_inertial for robot in self._robots])
        self._pose, self._twist = np.zeros((count, 7)), np.zeros((count, 6))
        self._links = np.zeros((count, len(setup.foot_links), 13))

    def step(self) -> None:
        """One policy step."""
        a, state = self.arrays, self.arrays.state
        state.effort_mean_square[:] = 0.0
        state.effort_clipped[:] = 0.0
        pushed = np.flatnonzero(a.impulse.any(axis=1))
        share = 1.0 / self.setup.decimation
        for _ in range(self.setup.decimation):
            actuate(
                self.setup.kind,
                a.parameters,
                a.weights,
                a.effort_limit,
                a.targets,
                state.joint_position,
                state.joint_velocity,
                state.joint_effort,
                state.actuator_memory,
                state.effort_mean_square,
                state.effort_clipped,
                share,
            )
            if pushed.size:
                self._push(pushed)
            self._advance()
        a.impulse[pushed] = 0.0
        self._read_bodies(range(len(self._robots)))
        self._read_contacts()

    def _advance(self) -> None:
        """One physics step with `joint_effort`; reads the joints afterwards."""
        client, state = self._client, self.arrays.state
        torque = state.joint_effort.tolist()
        apply, mode = pybullet.setJointMotorControlArray, pybullet.TORQUE_CONTROL
        for robot, forces in zip(self._robots, torque, strict=True):
            apply(robot.body, robot.joints, mode, forces=forces, physicsClientId=client)
        pybullet.stepSimulation(physicsClientId=client)
        read = pybullet.getJointStates
        rows = [read(robot.body, robot.joints, physicsClientId=client) for robot in self._robots]
        position, velocity, _, _ = zip(*chain.from_iterable(rows), strict=True)
        state.joint_position.ravel()[:] = position
        state.joint_velocity.ravel()[:] = velocity

    def _push(self, rows: np.ndarray) -> None:
        """Spread the impulses evenly over the policy step; the force acts on the base's centre of mass."""
        duration = self.setup.decimation * PHYSICS_DT
        for n in rows:
            body = self._robots[n].body
            place, _ = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
            force = (self.arrays.impulse[n] / duration).tolist()
            pybullet.applyExternalForce(body, -1, force, place, pybullet.WORLD_FRAME, physicsClientId=self._client)

    def _read_bodies(self, rows: Sequence[int]) -> None:
        """Base and feet of some robots; the other rows are written again from what was read last."""
        client, state = self._client, self.arrays.state
        for n in rows:
            robot = self._robots[n]
            place, turn = pybullet.getBasePositionAndOrientation(robot.body, physicsClientId=client)
            linear, angular = pybullet.getBaseVelocity(robot.body, physicsClientId=client)
            self._pose[n] = (*place, *turn)
            self._twist[n] = (*linear, *angular)
            # Not the link frame: pybullet rounds that to single precision.
            feet = pybullet.getLinkStates(robot.body, robot.feet, 1, computeForwardKinematics=1, physicsClientId=client)
            self._links[n] = [(*foot[0], *foot[1], *foot[6], *foot[7]) for foot in feet]
        base_from_com(
            self._inertial,
            self._pose,
            self._twist,
            state.base_position,
            state.base_orientation,
            state.base_linear_velocity,
            state.base_angular_velocity,
        )
        foot_from_com(self._foot_inertial, self._links, state.foot_position, state.foot_velocity)
        state.base_position[:] -= self._origin
        state.foot_position[:] -= self._origin[:, None]

    def _read_contacts(self) -> None:
        state = self.arrays.state
        state.illegal_contact[:] = False
        force = [[[0.0, 0.0, 0.0] for _ in robot.feet] for robot in self._robots]
        for point in pybullet.getContactPoints(physicsClientId=self._client):
            _, first, second, link, second_link, _, _, normal, distance, push, grip, along, side_grip, across = point
            if second != self._floor:
                first, link, push, grip, side_grip = second, second_link, -push, -grip, -side_grip
            if push == 0.0 and distance > 0.0:  # near, not touching
                continue
            n = self._row[first]
            robot = self._robots[n]
            if link in robot.foot_of_link:
                total = force[n][robot.foot_of_link[link]]
                for axis in range(3):
                    total[axis] += push * normal[axis] + grip * along[axis] + side_grip * across[axis]
            elif link not in robot.allowed_links:
                state.illegal_contact[n] = True
        state.foot_force[:] = force
        np.greater(state.foot_force[..., 2], 0.0, out=state.foot_contact)

    def reset(self, rows: np.ndarray) -> None:
        """Impose the state of some rows; contacts are unknown until the next step."""
        state, client = self.arrays.state, self._client
        for n in rows:
            robot = self._robots[n]
            com_from_base(
                self._inertial[n],
                state.base_position[n] + self._origin[n],
                state.base_orientation[n],
                state.base_linear_velocity[n],
                state.base_angular_velocity[n],
                self._pose[n],
                self._twist[n],
            )
            pose, twist = self._pose[n].tolist(), self._twist[n].tolist()
            pybullet.resetBasePositionAndOrientation(robot.body, pose[:3], pose[3:], physicsClientId=client)
            pybullet.resetBaseVelocity(robot.body, twist[:3], twist[3:], physicsClientId=client)
            for joint, q, qd in zip(robot.joints, state.joint_position[n], state.joint_velocity[n], strict=True):
                pybullet.resetJointState(robot.body, joint, q, qd, physicsClientId=client)
            renew_collisions(client, robot)
            for contact in (state.foot_force, state.foot_contact, state.illegal_contact):
                contact[n] = 0
        kept = {name: getattr(state, name)[rows].copy() for name in _BASE}
        self._read_bodies(rows)
        for name, values in kept.items():
            getattr(state, name)[rows] = values
        self.arrays.impulse[rows] = 0.0
        self.arrays.reset_flag[rows] = False

    def close(self) -> None:
        pybullet.disconnect(physicsClientId=self._client)


_BASE = ("base_position", "base_orientation", "base_linear_velocity", "base_angular_velocity")
