"""Effects on another base model: a drive with a PD law and a limit of its torque."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.machine import EFFECTS
from hqpipe.machine.bases.pd import PD
from hqpipe.machine.chain import Loops, Signals
from hqpipe.machine.compose.wiring import Chain

KP, KD, LIMIT, STEPS, DT = 300.0, 8.0, 30.0, 120, 1e-3
NAMES = ("command_delay", "valve_lag", "orifice_flow", "coulomb_friction", "viscous_friction")
SIZES = {
    ("command_delay", "delay_s"): 0.006,
    ("valve_lag", "time_constant_s"): 0.01,
    ("coulomb_friction", "friction_nm"): 5.0,
    ("viscous_friction", "nm_s_per_rad"): 2.0,
}


@pytest.fixture(scope="module")
def drive():
    return Loops(Chain(PD, [EFFECTS[name] for name in NAMES]))


def row_of(drive, sizes):
    row = drive.chain.neutral_row()
    for name, value in {("base", "kp"): KP, ("base", "kd"): KD, ("setting", "effort_limit"): LIMIT, **sizes}.items():
        row[drive.chain.column(*name)] = value
    return row


@pytest.fixture(scope="module")
def motion():
    """(T,) command, position, speed."""
    time = np.arange(1501) * DT
    q = 0.3 * np.sin(5.0 * time) + 0.1 * np.sin(17.0 * time)
    return q + 0.1 * np.sin(11.0 * time), q, 1.5 * np.cos(5.0 * time) + 1.7 * np.cos(17.0 * time)


def windows(drive, row, motion, effort):
    """(steps, W) predicted torque."""
    command, q, qd = motion
    first = np.arange(0, len(q) - STEPS, STEPS)
    target = np.ascontiguousarray(effort[first[None, :] + np.arange(STEPS + 1)[:, None]])
    time, bounds = np.arange(len(q)) * DT, np.array([0, len(q)])
    signals = Signals(command, q, qd, effort, time, np.zeros(len(q)), bounds, first, STEPS, target)
    return drive.residual_windows(row, signals) + target[1:]


def stepped(drive, row, motion, robots=None):
    """(T,) torque of a row of one joint, or of the last of a batch of robots."""
    torque, memory = np.zeros(robots or 1), np.zeros((robots or 1, drive.memory))
    planes, prepared, out = np.zeros((drive.memory, robots or 1)), drive.prepare(row[None]), np.zeros(len(motion[0]))
    for k in range(len(out) - 1):
        given = [np.full(robots or 1, x[k]) for x in motion]
        if robots:
            drive.step_batch(*prepared, torque, planes, *given, 1)
        else:
            drive.step_row(row[None], torque, memory, *given)
        out[k + 1] = torque[-1]
    return out


def law(motion):
    """(T,) torque after each sample, by the law alone."""
    command, q, qd = motion
    return np.concatenate([[0.0], np.clip(KP * (command - q) - KD * qd, -LIMIT, LIMIT)[:-1]])


def test_without_effects_it_is_the_law(drive, motion):
    row, expected = row_of(drive, {}), law(motion)
    found = windows(drive, row, motion, expected)
    np.testing.assert_array_equal(found.T.ravel(), expected[1 : found.size + 1])
    np.testing.assert_array_equal(stepped(drive, row, motion), expected)
    np.testing.assert_array_equal(stepped(drive, row, motion, robots=5), expected)
    assert np.abs(expected).max() == LIMIT


def test_an_effect_on_the_load_that_a_drive_does_not_have_is_left_out(drive):
    """What the orifice bends is read by this law, and its load is the torque; what it leaks is not."""
    assert "passed" in {ref.name for ref in drive.chain.law.args}
    chain = Chain(PD, EFFECTS.values())
    assert not [link for link in chain.links if link.name.startswith(("leakage_drift", "transmission_compliance"))]


@pytest.mark.parametrize("name", [(name,) for name in SIZES] + [tuple(SIZES)], ids=lambda names: names[-1][0])
def test_effects_compose_with_it_in_windows_rows_and_batches(drive, motion, name):
    row = row_of(drive, {key: SIZES[key] for key in name})
    one = stepped(drive, row, motion)
    np.testing.assert_allclose(stepped(drive, row, motion, robots=5), one, rtol=0.0, atol=1e-9)
    assert np.abs(one - law(motion)).max() > 1.0
    if len(name) == 1 and name[0][0] in ("command_delay", "valve_lag"):
        found = windows(drive, row, motion, law(motion))
        np.testing.assert_allclose(found.T.ravel(), one[1 : found.size + 1], rtol=0.0, atol=1e-9)


def test_a_lag_is_that_of_its_equation(drive, motion):
    command, q, qd = motion
    share, spool, expected = 1.0 - np.exp(-DT / 0.01), command[0] - q[0], [0.0]
    mean = 1.0 - 10.0 * share
    for k in range(len(q) - 1):
        error = command[k] - q[k]
        expected.append(np.clip(KP * (spool + mean * (error - spool)) - KD * qd[k], -LIMIT, LIMIT))
        spool += share * (error - spool)
    found = stepped(drive, row_of(drive, {("valve_lag", "time_constant_s"): 0.01}), motion)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
