"""The compiled loop of the MuJoCo engine: actuator, physics and read-out of many robots without Python's lock."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import carray, njit

from hqpipe.sim.actuation import actuate, robots_at_once
from hqpipe.sim.frames import add_cross, rotate
from hqpipe.sim.native_call import call_step, double_pointer

FREE_QPOS, FREE_QVEL = 7, 6  # sizes of the free joint, which comes first


class Functions(NamedTuple):
    """Addresses of MuJoCo's functions of (mjModel*, mjData*)."""

    step: int
    kinematics: int
    com_position: int
    com_velocity: int
    contact_forces: int


class Addresses(NamedTuple):
    """(N,) int64 addresses of mjModel, mjData and of arrays in mjData, one per robot."""

    model: np.ndarray
    data: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    qfrc_applied: np.ndarray
    xpos: np.ndarray
    cvel: np.ndarray
    subtree_com: np.ndarray
    cfrc_ext: np.ndarray


class Layout(NamedTuple):
    """Where MuJoCo keeps joints and links; the same for every robot of a world.

    Attributes:
        qpos, dof: (J,) indices of the joints.
        feet: (F,) body numbers; base: body number.
        base_com: (N, 3) centre of mass of the base in its frame, m.
        illegal: (B,) bool, bodies that must not touch the ground.
    """

    qpos: np.ndarray
    dof: np.ndarray
    feet: np.ndarray
    base: int
    base_com: np.ndarray
    illegal: np.ndarray


class Rows(NamedTuple):
    """The arrays of hqpipe.sim.state that the loop reads and writes."""

    base_position: np.ndarray
    base_orientation: np.ndarray
    base_linear_velocity: np.ndarray
    base_angular_velocity: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    joint_effort: np.ndarray
    actuator_memory: np.ndarray
    effort_mean_square: np.ndarray
    effort_clipped: np.ndarray
    foot_position: np.ndarray
    foot_velocity: np.ndarray
    foot_force: np.ndarray
    foot_contact: np.ndarray
    illegal_contact: np.ndarray
    targets: np.ndarray
    parameters: np.ndarray
    weights: np.ndarray
    effort_limit: np.ndarray
    impulse: np.ndarray


@njit(cache=True, nogil=True)
def step_robots(
    functions: Functions,
    at: Addresses,
    layout: Layout,
    rows: Rows,
    kind: int,
    decimation: int,
    duration: float,
) -> None:
    """One policy step of `decimation` physics steps for every robot; `duration` in s."""
    robots, together = at.data.shape[0], robots_at_once(kind)
    for first in range(0, robots, together):
        last = min(first + together, robots)
        rows.effort_mean_square[first:last] = 0.0
        rows.effort_clipped[first:last] = 0.0
        for _ in range(decimation):
            actuate(
                kind,
                rows.parameters[first:last],
                rows.weights,
                rows.effort_limit[first:last],
                rows.targets[first:last],
                rows.joint_position[first:last],
                rows.joint_velocity[first:last],
                rows.joint_effort[first:last],
                rows.actuator_memory[first:last],
                rows.effort_mean_square[first:last],
                rows.effort_clipped[first:last],
                1.0 / decimation,
            )
            for n in range(first, last):
                step_physics(functions, at, layout, rows, n, duration)
        for n in range(first, last):
            if rows.impulse[n].any():
                carray(double_pointer(at.qfrc_applied[n]), FREE_QVEL)[:] = 0.0
                rows.impulse[n] = 0.0
            read_contacts(functions, at, layout, rows, n)
            read_bodies(functions, at, layout, rows, n)


@njit(cache=True, nogil=True)
def step_physics(functions: Functions, at: Addresses, layout: Layout, rows: Rows, n: int, duration: float) -> None:
    """One physics step of one robot with its torques and its share of the impulse over `duration`, s; reads its joints."""
    joints = layout.qpos.shape[0]
    applied = carray(double_pointer(at.qfrc_applied[n]), FREE_QVEL + joints)
    qpos = carray(double_pointer(at.qpos[n]), FREE_QPOS + joints)
    qvel = carray(double_pointer(at.qvel[n]), FREE_QVEL + joints)
    if rows.impulse[n].any():
        push(qpos, layout.base_com[n], rows.impulse[n] / duration, applied)
    for j in range(joints):
        applied[layout.dof[j]] = rows.joint_effort[n, j]
    call_step(functions.step, at.model[n], at.data[n])
    for j in range(joints):
        rows.joint_position[n, j] = qpos[layout.qpos[j]]
        rows.joint_velocity[n, j] = qvel[layout.dof[j]]


@njit(cache=True, nogil=True)
def push(qpos: np.ndarray, base_com: np.ndarray, force: np.ndarray, applied: np.ndarray) -> None:
    """Force at the base's centre of mass as the generalised force of the free joint: world force, body torque."""
    local = np.empty(3)
    back = np.array((-qpos[4], -qpos[5], -qpos[6], qpos[3]))
    rotate(back, force, local)
    applied[:3] = force
    applied[3:FREE_QVEL] = 0.0
    add_cross(base_com, local, 1.0, applied[3:FREE_QVEL])


@njit(cache=True, nogil=True)
def read_contacts(functions: Functions, at: Addresses, layout: Layout, rows: Rows, n: int) -> None:
    """Contact forces of the last physics step; cfrc_ext holds torque and force of the contacts on each body."""
    call_step(functions.contact_forces, at.model[n], at.data[n])
    bodies = layout.illegal.shape[0]
    forces = carray(double_pointer(at.cfrc_ext[n]), (bodies, 6))
    rows.illegal_contact[n] = False
    for b in range(bodies):
        if layout.illegal[b] and forces[b, 5] > 0.0:
            rows.illegal_contact[n] = True
    for f in range(layout.feet.shape[0]):
        rows.foot_force[n, f] = forces[layout.feet[f], 3:]
        rows.foot_contact[n, f] = forces[layout.feet[f], 5] > 0.0


@njit(cache=True, nogil=True)
def read_bodies(functions: Functions, at: Addresses, layout: Layout, rows: Rows, n: int) -> None:
    """Base and feet of the present state; mj_step leaves the kinematics of the state before its last step."""
    call_step(functions.kinematics, at.model[n], at.data[n])
    call_step(functions.com_position, at.model[n], at.data[n])
    call_step(functions.com_velocity, at.model[n], at.data[n])
    qpos = carray(double_pointer(at.qpos[n]), FREE_QPOS)
    qvel = carray(double_pointer(at.qvel[n]), FREE_QVEL)
    bodies = layout.illegal.shape[0]
    place = carray(double_pointer(at.xpos[n]), (bodies, 3))
    twist = carray(double_pointer(at.cvel[n]), (bodies, 6))
    centre = carray(double_pointer(at.subtree_com[n]), (bodies, 3))[layout.base]
    rows.base_position[n] = qpos[:3]
    rows.base_orientation[n, :3] = qpos[4:7]
    rows.base_orientation[n, 3] = qpos[3]
    rows.base_linear_velocity[n] = qvel[:3]
    rows.base_angular_velocity[n] = qvel[3:6]
    for f in range(layout.feet.shape[0]):
        body = layout.feet[f]
        rows.foot_position[n, f] = place[body]
        rows.foot_velocity[n, f] = twist[body, 3:]  # of the point of the foot that lies at the robot's centre of mass
        add_cross(twist[body, :3], place[body] - centre, 1.0, rows.foot_velocity[n, f])
