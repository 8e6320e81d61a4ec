"""The two chambers against mass balance, limits, mirror symmetry and their own fine steps."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.loops.actuator_step import CHAMBERS, NO_WEIGHTS, step_batch
from hqpipe.actuators.loops.chamber_step import MEMORY, SPOOL, SUM, chamber_joint, relaxed, root, root_slope
from hqpipe.actuators.loops.chamber_windows import replay

FULL, STIFF, FLOW, LAG, LEAK, NULL, SLOPE = 900.0, 20_000.0, 25.0, 0.0015, 3.0, 0.001, 0.4
DT, LIMIT = 1e-3, 2000.0


def row(**changed):
    """Parameters of a joint in the order of the kernel."""
    values = {
        "full": FULL, "stiff": STIFF, "flow": FLOW, "lag": LAG, "leak": LEAK, "null": NULL, "slope": SLOPE,
        "coulomb": 0.0, "viscous": 0.0, "speed": np.inf, "middle": 0.0, "dt": DT, "limit": LIMIT,
    }  # fmt: skip
    return np.array(list((values | changed).values()))


def drive(p, torque, q_des, q, qd, dt=DT):
    """Torque and memory after every sample of a motion q(t), from the callables q_des, q and qd of time."""
    memory, found = np.zeros(MEMORY), []
    p = p.copy()
    p[11] = dt
    for k in range(round(0.1 / dt)):
        t = k * dt
        torque = chamber_joint(p, memory, torque, q_des(t), q(t), qd(t))
        found.append((torque, *memory))
    return np.array(found)


def held(value):
    return lambda t: value


def test_closed_valve_and_seals_make_a_spring():
    """No flow: the torque answers a motion with the stiffness of two trapped volumes, whatever the path."""
    p = row(leak=0.0, null=0.0, slope=0.0)
    motion = lambda t: 0.01 * (1.0 - np.cos(40.0 * t))  # noqa: E731
    found = drive(p, 0.0, motion, motion, lambda t: 0.4 * np.sin(40.0 * t))
    t = DT * (np.arange(len(found)) + 1)
    np.testing.assert_allclose(found[:, 0], -STIFF * motion(t), atol=2.0)
    assert found[:, 1 + SUM] == pytest.approx(1.0, abs=1e-9), "what one chamber loses the other gains"


def test_leakage_alone_fades_the_torque_exponentially():
    valve_shut = row(null=0.0, slope=0.0, lag=1e-6)
    found = drive(valve_shut, 300.0, held(0.0), held(0.0), held(0.0))
    assert found[49, 0] == pytest.approx(300.0 * np.exp(-STIFF * LEAK / FULL * 0.05), rel=5e-3)


def test_no_load_speed_is_gain_times_opening():
    p = row(leak=0.0, null=0.0, slope=0.0)
    opening, speed = 0.04, FLOW * 0.04
    found = drive(p, 0.0, lambda t: speed * t + opening, lambda t: speed * t, held(speed))
    assert abs(found[-1, 0]) < 0.01 * FULL


def test_full_torque_is_what_the_supply_gives_a_blocked_joint():
    found = drive(row(leak=0.0), 0.0, held(0.3), held(0.0), held(0.0))
    assert found[-1, 0] == pytest.approx(FULL, rel=1e-3) and found[:, 0].max() <= FULL * 1.001


def test_blocked_joint_gives_no_more_than_the_supply_and_no_chamber_sucks():
    rng = np.random.default_rng(0)
    memory, torque, p = np.zeros(MEMORY), 0.0, row()
    for error in rng.normal(0, 0.3, 5000):
        torque = chamber_joint(p, memory, torque, error, 0.0, 0.0)
        a, b = 0.5 * (memory[SUM] + torque / FULL), 0.5 * (memory[SUM] - torque / FULL)
        assert -1e-12 <= min(a, b) and max(a, b) <= 1.0 + 5e-3


def test_speed_limit_cuts_the_opening():
    p = row(speed=5.0)
    found = drive(p, 0.0, held(3.0), held(0.0), held(0.0))
    assert found[-1, 1 + SPOOL] == pytest.approx(5.0 / FLOW)


def test_energy_is_lost_never_made():
    """A joint moved to and fro against a closed, leaking actuator ends with work done on the oil."""
    speed = lambda t: 2.0 * np.cos(2 * np.pi * 20.0 * t)  # noqa: E731
    q = lambda t: 2.0 / (2 * np.pi * 20.0) * np.sin(2 * np.pi * 20.0 * t)  # noqa: E731
    found = drive(row(null=0.0), 0.0, q, q, speed, dt=1e-4)
    middle = speed(1e-4 * (np.arange(len(found)) + 1))
    assert (found[:, 0] * middle).sum() * 1e-4 < 0.0


def test_wakes_in_steady_motion():
    """A loaded joint in even motion that the command leads by what that needs goes on as it was."""
    speed, load = 1.0, 200.0
    lead = (speed + LEAK * load / FULL) / (FLOW * np.sqrt(1.0 - load / FULL))
    found = drive(row(null=0.0, slope=0.0), load, lambda t: speed * t + lead, lambda t: speed * t, held(speed))
    np.testing.assert_allclose(found[:, 0], load, rtol=1e-2)


def test_friction_is_in_the_torque_that_a_log_starts_with():
    free, rough = (
        drive(row(coulomb=c, null=0.0, leak=0.0), 0.0, held(0.0), held(0.0), held(1.0))[0, 0] for c in (0.0, 10.0)
    )
    assert free == pytest.approx(rough, abs=0.01)  # of 10 N·m; the pressures behind the valve differ a little


def test_friction_opposes_the_motion():
    torques = []
    for coulomb in (0.0, 10.0):
        p, memory = row(coulomb=coulomb), np.zeros(MEMORY)
        chamber_joint(p, memory, 0.0, 0.0, 0.0, 0.0)
        torques.append(chamber_joint(p, memory, 0.0, 0.0, 0.0, 1.0))
    assert torques[1] - torques[0] == pytest.approx(-10.0, rel=0.01)


def test_second_order_in_the_step():
    """A millisecond is fine enough, and halving the step of a held command quarters the error."""
    arguments = (row(), 100.0, held(0.05), held(0.0), held(0.0))
    exact = drive(*arguments, dt=1e-3 / 64)[64 * 10 - 1, 0]
    errors = [abs(drive(*arguments, dt=1e-3 / n)[10 * n - 1, 0] - exact) for n in (1, 2, 4)]
    assert errors[0] < 1.0 and errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_mirror():
    rng = np.random.default_rng(1)
    tau, q_des, q, qd = (rng.normal(0, s, (16, 3)) for s in (200.0, 0.2, 0.2, 2.0))
    table = np.tile(row(coulomb=5.0, viscous=1.0), (3, 1))
    mirrored, memory, other = -tau, np.zeros((16, 3, MEMORY)), np.zeros((16, 3, MEMORY))
    for _ in range(20):
        step_batch(CHAMBERS, table, NO_WEIGHTS, tau, memory, q_des, q, qd)
        step_batch(CHAMBERS, table, NO_WEIGHTS, mirrored, other, -q_des, -q, -qd)
    np.testing.assert_array_equal(mirrored, -tau)
    np.testing.assert_array_equal(memory[..., SUM], other[..., SUM])


def test_stays_finite_in_a_violent_machine():
    rng = np.random.default_rng(2)
    p, memory, torque = row(limit=np.inf, lag=1e-5), np.zeros(MEMORY), 1e4
    for _ in range(2000):
        torque = chamber_joint(p, memory, torque, *rng.normal(0, 10.0, 2), rng.normal(0, 100.0))
        assert np.isfinite(torque) and np.isfinite(memory).all()


def test_root_is_smooth_odd_and_turbulent():
    drop = np.array([0.01, 0.1, 0.5, 1.0])
    assert [root(-d) for d in drop] == [-root(d) for d in drop]
    assert root(0.5) == pytest.approx(1.0, rel=5e-3)
    slopes = [(root(d + 1e-8) - root(d - 1e-8)) / 2e-8 for d in (0.0, *drop)]
    np.testing.assert_allclose([root_slope(d) for d in (0.0, *drop)], slopes, rtol=1e-5)


def test_relaxation_has_the_exponential_and_its_limits():
    z = np.array([1e-9, 0.1, 1.0])
    np.testing.assert_allclose([relaxed(v) for v in z], -np.expm1(-z) / z, rtol=1e-2)
    assert relaxed(1e6) * 1e6 == pytest.approx(1.0, rel=1e-4)


def test_replay_hands_over_the_memory_that_the_log_left():
    """Windows of a log that the model made itself restart into the same trajectory."""
    rng = np.random.default_rng(3)
    command = np.repeat(rng.normal(0, 0.1, 40), 10)
    q = 0.05 * np.sin(np.arange(400) * 0.05)
    qd = np.gradient(q, DT)
    p, memory, effort = row(coulomb=5.0), np.zeros(MEMORY), np.zeros(400)
    for k in range(399):
        effort[k + 1] = chamber_joint(p, memory, effort[k], command[k], q[k], qd[k])
    bounds = np.stack([np.arange(0, 399, 57), np.append(np.arange(57, 399, 57), 399)], axis=1)
    simulated = np.zeros(400)
    replay(p, effort, command, q, qd, bounds, bounds[:, 0] == 0, simulated)
    np.testing.assert_allclose(simulated[1:], effort[1:], atol=1e-9)
