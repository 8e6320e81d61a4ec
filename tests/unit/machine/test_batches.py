"""Many robots at once against one sample after the other."""

from __future__ import annotations

import numpy as np
import pytest
from machine.augmented_rows import planted, row

from hqpipe.actuators.loops.actuator_step import HYDRAULIC, table_row
from hqpipe.actuators.loops.batch_step import hydraulic_batch, hydraulic_columns
from hqpipe.machine.chain import BLOCK, loops

MEMORY, augmented_row = loops().memory, loops().step_row
prepare, augmented_batch = loops().prepare, loops().step_batch
JOINTS = 3
ROBOTS = BLOCK // JOINTS + 5  # one whole block and a part of one
STEPS = 60
RESET_AT, RESET = 25, 7  # a robot that starts anew in between
EFFECTS = [name for name in planted.TYPICAL if name not in ("channel_skew", "torque_bias")]  # those of a machine


def motion(seed: int):
    """(STEPS, ROBOTS, JOINTS) command, position and speed of a random walk, and a torque to begin with."""
    rng = np.random.default_rng(seed)
    speed = np.cumsum(rng.normal(0.0, 0.2, (STEPS, ROBOTS, JOINTS)), axis=0)
    position = np.cumsum(speed, axis=0) * 1e-3
    command = position + rng.normal(0.0, 0.05, speed.shape)
    return command, position, speed, rng.normal(0.0, 100.0, (ROBOTS, JOINTS))


def one_by_one(rows, q_des, q, qd, start):
    tau, memory = start.copy(), np.zeros((ROBOTS, JOINTS, MEMORY))
    for k in range(STEPS):
        if k == RESET_AT:
            memory[RESET], tau[RESET] = 0.0, start[RESET]
        for n in range(ROBOTS):
            augmented_row(rows, tau[n], memory[n], q_des[k, n], q[k, n], qd[k, n])
    return tau


def at_once(rows, q_des, q, qd, start):
    tau, memory = start.copy(), np.zeros((MEMORY, ROBOTS, JOINTS))
    for k in range(STEPS):
        if k == RESET_AT:
            memory[:, RESET], tau[RESET] = 0.0, start[RESET]
        flat = (values[k].reshape(-1) for values in (q_des, q, qd))
        augmented_batch(*prepare(rows), tau.reshape(-1), memory.reshape(MEMORY, -1), *flat, JOINTS)
    return tau


@pytest.mark.parametrize("effects", [(), *((name,) for name in EFFECTS), tuple(EFFECTS)], ids="+".join)
def test_effects_step_alike(effects):
    sizes = {name: planted.TYPICAL[name] for name in effects}
    rows = np.array([row(sizes), row({}), row(sizes, k1=900.0)])  # a joint may lack what its neighbours have
    inputs = motion(len(effects))
    expected = one_by_one(rows, *inputs)
    np.testing.assert_allclose(at_once(rows, *inputs), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_spools_of_second_order_step_alike():
    swinging, plain = {"time_constant_s": 0.012, "damping_ratio": 0.6}, {"time_constant_s": 0.005}
    rows = np.array([row({"valve_lag": swinging}), row({}), row({"valve_lag": plain})])
    inputs = motion(8)
    expected = one_by_one(rows, *inputs)
    np.testing.assert_allclose(at_once(rows, *inputs), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_pistons_behind_their_joints_step_alike():
    sizes = {
        "viscous_friction": {"nm_s_per_rad": 60.0, "behind_piston": 0.3},
        "coulomb_friction": {"friction_nm": 20.0},
    }
    rows = np.array([row(sizes), row({}), row({"valve_lag": {"time_constant_s": 0.005}})])
    inputs = motion(7)
    expected = one_by_one(rows, *inputs)
    np.testing.assert_allclose(at_once(rows, *inputs), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
    sizes["viscous_friction"]["behind_piston"] = 0.0
    assert np.abs(one_by_one(np.array([row(sizes), row({}), row({})]), *inputs) - expected)[:, 0].max() > 1.0


def test_every_effect_changes_the_torque():
    """Or the comparison above would compare nothing."""
    inputs = motion(0)
    plain = at_once(np.array([row({})] * JOINTS), *inputs)
    for name in EFFECTS:
        changed = at_once(np.array([row({name: planted.TYPICAL[name]})] * JOINTS), *inputs)
        assert np.abs(changed - plain).max() > 0.01, name


def test_plain_model_steps_alike():
    rng = np.random.default_rng(3)
    table = rng.uniform([1e4, 0.01, 100.0, 1.0, 0.04, 5.0], [2e4, 0.1, 400.0, 30.0, 0.06, 40.0], (JOINTS, 6))
    q_des, q, qd, tau = motion(1)
    single, batch, nothing = tau.copy(), tau.copy(), np.zeros((JOINTS, 0))
    for k in range(STEPS):
        for n in range(ROBOTS):
            table_row(HYDRAULIC, table, single[n], nothing, q_des[k, n], q[k, n], qd[k, n])
        flat = (values[k].reshape(-1) for values in (q_des, q, qd))
        hydraulic_batch(hydraulic_columns(table), batch.reshape(-1), *flat)
    assert (np.abs(single) == table[:, 5]).any()  # some at their limit
    np.testing.assert_allclose(batch, single, rtol=1e-12)
