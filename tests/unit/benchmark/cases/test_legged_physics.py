"""The physics of the withheld legged machines against what is known from elsewhere."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hqpipe.benchmark.cases.legged.body import FRICTION, invert, leg_terms, plate_force
from hqpipe.benchmark.cases.legged.hydraulics import (
    PA,
    PB,
    PISTON,
    PISTON_SPEED,
    SPOOL,
    STEP,
    advance,
    drive_spool,
    flows,
    lever,
    link_force,
    uncovered,
)
from hqpipe.benchmark.cases.legged.robots import ROBOTS, quadruped, small_quadruped
from hqpipe.robots import load_robot


def terms(body, leg: int, q: np.ndarray, dq: np.ndarray):
    """Mass matrix, bias, foot and its Jacobian."""
    n = len(q)
    mass, bias, foot, jacobian = np.zeros((n, n)), np.zeros(n), np.zeros(3), np.zeros((3, n))
    leg_terms(body, leg, q, dq, np.zeros((n, 15, 3)), mass, bias, foot, jacobian)
    return mass, bias, foot, jacobian


def test_quadruped_moves_as_in_another_engine():
    """Mass matrix and bias of every leg against MuJoCo on the same URDF, its trunk held."""
    robot, body = load_robot("hydraulic_quadruped"), quadruped().body
    spec = mujoco.MjSpec.from_file(str(robot.urdf))
    spec.compiler.fusestatic = False
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    data.qpos[:], data.qvel[:] = rng.uniform(-0.8, 0.8, model.nq), rng.uniform(-3.0, 3.0, model.nv)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    at = {name: int(model.joint(name).dofadr[0]) for name in robot.joints}
    for leg in range(4):
        rows = [at[name] for name in robot.joints[3 * leg : 3 * leg + 3]]
        mass, bias, _, _ = terms(body, leg, data.qpos[rows].copy(), data.qvel[rows].copy())
        assert np.allclose(mass, full[np.ix_(rows, rows)], rtol=1e-6, atol=1e-8)
        assert np.allclose(bias, data.qfrc_bias[rows], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("robot", ROBOTS)
def test_foot_moves_as_its_jacobian_says(robot):
    body, n = robot().body, robot().per_leg
    q, step = robot().stand[:n].copy(), 1e-6
    _, _, foot, jacobian = terms(body, 0, q, np.zeros(n))
    for k in range(n):
        moved = q.copy()
        moved[k] += step
        assert np.allclose((terms(body, 0, moved, np.zeros(n))[2] - foot) / step, jacobian[:, k], atol=1e-5)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_free_leg_keeps_its_energy(robot):
    """Kinetic and potential energy of a falling leg without joint torques stay within 0.5 % of what is exchanged."""
    body, n, dt = robot().body, robot().per_leg, 2e-5
    q, dq, inverse = robot().stand[:n].copy(), np.zeros(n), np.zeros((n, n))
    energies, kinetic = [], []
    height = 0.0
    for _ in range(10000):
        mass, bias, _, _ = terms(body, 0, q, dq)
        gravity = terms(body, 0, q, np.zeros(n))[1]
        kinetic.append(0.5 * dq @ mass @ dq)
        energies.append(kinetic[-1] + height)
        invert(mass, inverse)
        before = dq.copy()
        dq = dq - dt * inverse @ bias
        middle = 0.5 * (before + dq)
        height += dt * gravity @ middle
        q = q + dt * middle
    assert max(kinetic) > 0.1
    assert np.ptp(energies) < 5e-3 * max(kinetic)


def test_oil_that_is_taken_is_oil_that_is_displaced():
    """Steady motion: the supply gives what the piston sweeps and what leaks past the open centre."""
    joint = quadruped().cylinders[0].copy()
    joint["leakage"], joint["overlap"], joint["coulomb"] = 0.0, 0.0, 0.0
    state = np.zeros(8)
    state[PA] = state[PB] = 10e6
    state[SPOOL] = 0.2
    for _ in range(2000):
        state[PISTON] = 0.0
        drawn = advance(joint, state, 21e6, 0.5e6, 0.0, 0.0)
    assert drawn == pytest.approx(joint["area_a"] * state[PISTON_SPEED], rel=0.02)


def test_a_held_piston_stays_where_its_seals_hold():
    joint = quadruped().cylinders[0].copy()
    joint["coulomb"] = 500.0
    state = np.zeros(8)
    state[PA] = state[PB] = 10e6
    joint["flow"] = 0.0
    for _ in range(500):
        advance(joint, state, 21e6, 0.5e6, 450.0, 0.0)
    assert state[PISTON] == 0.0
    for _ in range(5):
        advance(joint, state, 21e6, 0.5e6, 900.0, 0.0)
    assert state[PISTON] < 0.0


@pytest.mark.parametrize(("overlap", "flows_at_small"), [(0.05, False), (0.0, True)])
def test_overlap_closes_the_lands(overlap, flows_at_small):
    joint = quadruped().cylinders[0].copy()
    joint["overlap"] = overlap
    state = np.zeros(8)
    state[PA] = state[PB] = 10e6
    state[SPOOL] = 0.04
    assert (flows(joint, state, 21e6, 0.5e6)[0] > 0.02 * joint["flow"] * np.sqrt(10e6)) == flows_at_small
    assert uncovered(0.3, 1e-3) == pytest.approx(0.3, rel=1e-4)


def test_a_spool_settles_at_its_command_after_its_lag():
    joint = small_quadruped().cylinders[0].copy()
    state, places = np.zeros(8), []
    for step in range(400):
        drive_spool(joint, state, 0.3, step * STEP)
        places.append(state[SPOOL])
    assert places[-1] == pytest.approx(0.3, rel=1e-3)
    mean_delay = STEP * np.sum(0.3 - np.array(places)) / 0.3
    assert mean_delay == pytest.approx(joint["damping"] / (np.pi * joint["natural_hz"]), rel=0.1)


def test_moment_arm_is_the_slope_of_the_piston():
    joint = small_quadruped().cylinders[1]
    for angle in (0.2, 0.6, 1.0):
        place, arm = lever(joint, angle)
        assert (lever(joint, angle + 1e-6)[0] - place) / 1e-6 == pytest.approx(arm, rel=1e-4)
    assert lever(joint, joint["middle"])[0] == pytest.approx(0.0, abs=1e-12)


def test_play_passes_no_force():
    joint = quadruped().cylinders[0].copy()
    joint["play"] = 1e-3
    state = np.zeros(8)
    assert link_force(joint, state, 0.4e-3, 0.0) == 0.0
    assert link_force(joint, state, -0.6e-3, 0.0) == pytest.approx(joint["link_stiffness"] * 0.1e-3)


def test_a_plate_pushes_only_and_holds_up_to_its_friction():
    anchor, force = np.zeros(3), np.zeros(3)
    plate_force(np.array([0.0, 0.0, 0.01]), np.zeros(3), 0.0, 1e5, anchor, force)
    assert not force.any()
    plate_force(np.array([0.0, 0.0, -0.01]), np.zeros(3), 0.0, 1e5, anchor, force)
    plate_force(np.array([0.5, 0.0, -0.01]), np.zeros(3), 0.0, 1e5, anchor, force)
    assert force[2] == pytest.approx(1000.0)
    assert np.hypot(force[0], force[1]) == pytest.approx(FRICTION * 1000.0)
