"""The compiled actuator models against the paper's equation, written out once more in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.actuators.loops.actuator_step import (
    AUGMENTED,
    HYDRAULIC,
    NO_WEIGHTS,
    PD,
    step_batch,
    step_joint,
    step_row,
    take_back,
)
from hqpipe.actuators.loops.free_run import free_run
from hqpipe.machine.chain import loops
from hqpipe.machine.compose.rows import WOUND
from hqpipe.machine.layout import neutral_row, slot

MEMORY = loops().memory
RADIUS = 0.06
ROW = np.array([5.0e4, 0.02, 3.0e3, 2.0, RADIUS, 900.0])


def paper(p, torque, q_des, q, qd):
    """Eq. (7) as printed, then the effort limit."""
    k1, k2, k3, k4, r, limit = p
    error = q_des - q
    following = (
        k1 * r**2 * error
        + (1 - k2) * torque
        - k3 * r**2 * qd
        + k4 * r * error * np.maximum(-torque * np.sign(error), 0.0)
    )
    return np.clip(following, -limit, limit)


def memory(tau):
    """Of a kind that remembers nothing."""
    return np.zeros((*tau.shape, 0))


@pytest.fixture
def batch():
    rng = np.random.default_rng(3)
    shape = (50, 12)
    return (
        rng.normal(0, 300, shape),
        rng.normal(0, 0.1, shape),
        rng.normal(0, 0.1, shape),
        rng.normal(0, 3, shape),
    )


def test_hydraulic_batch_is_the_paper_equation(batch):
    tau, q_des, q, qd = batch
    parameters = np.tile(ROW, (12, 1)) * np.linspace(0.8, 1.2, 12)[:, None]
    expected = np.stack([paper(parameters[j], tau[:, j], q_des[:, j], q[:, j], qd[:, j]) for j in range(12)], axis=1)
    opposed = (tau * (q_des - q) < 0).mean()
    assert 0.3 < opposed < 0.7, "both branches of the impact term must be exercised"
    step_batch(HYDRAULIC, parameters, NO_WEIGHTS, tau, memory(tau), q_des, q, qd)
    np.testing.assert_allclose(tau, expected, rtol=1e-12)


def test_pd_batch_is_a_clipped_pd_law(batch):
    tau, q_des, q, qd = batch
    parameters = np.tile([6000.0, 200.0, 500.0], (12, 1))
    step_batch(PD, parameters, NO_WEIGHTS, tau, memory(tau), q_des, q, qd)
    expected = np.clip(6000.0 * (q_des - q) - 200.0 * qd, -500.0, 500.0)
    np.testing.assert_allclose(tau, expected, rtol=1e-12)
    assert (np.abs(expected) == 500.0).any() and (np.abs(expected) < 500.0).any()


def test_zero_error_leaks_and_resists_only():
    torque = step_joint(HYDRAULIC, ROW, 100.0, 0.3, 0.3, 0.5)
    assert torque == pytest.approx(98.0 - 3.0e3 * RADIUS**2 * 0.5)


def test_impact_term_pushes_towards_the_target():
    without = ROW.copy()
    without[3] = 0.0
    opposed = (-200.0, 0.1, 0.0, 0.0)
    assert step_joint(HYDRAULIC, ROW, *opposed) > step_joint(HYDRAULIC, without, *opposed)
    agreeing = (200.0, 0.1, 0.0, 0.0)
    assert step_joint(HYDRAULIC, ROW, *agreeing) == step_joint(HYDRAULIC, without, *agreeing)


@pytest.mark.parametrize(("kind", "row"), [(PD, [6000.0, 200.0, 500.0]), (HYDRAULIC, ROW)])
def test_row_joint_and_batch_agree(batch, kind, row):
    tau, q_des, q, qd = batch
    parameters = np.tile(row, (12, 1))
    single = [step_joint(kind, parameters[j], tau[0, j], q_des[0, j], q[0, j], qd[0, j]) for j in range(12)]
    one = tau[0].copy()
    step_row(kind, parameters, NO_WEIGHTS, one, memory(one), q_des[0], q[0], qd[0])
    step_batch(kind, parameters, NO_WEIGHTS, tau, memory(tau), q_des, q, qd)
    np.testing.assert_array_equal(one, single)
    np.testing.assert_array_equal(tau[0], single)


def test_free_run_restarts_from_the_log_at_each_window():
    rng = np.random.default_rng(4)
    effort, q_des, q, qd = (rng.normal(0, s, (41, 1)) for s in (300.0, 0.1, 0.1, 3.0))
    predicted = free_run(HYDRAULIC, ROW[None], effort, q_des, q, qd, 10)
    expected = np.empty(41)
    torque = expected[0] = effort[0, 0]
    for k in range(40):
        torque = effort[k, 0] if k in (0, 10, 20, 30) else torque
        torque = expected[k + 1] = paper(ROW, torque, q_des[k, 0], q[k, 0], qd[k, 0])
    np.testing.assert_allclose(predicted[:, 0], expected, rtol=1e-12)


def test_window_of_one_sample_is_the_one_step_prediction(batch):
    tau, q_des, q, qd = batch
    parameters = np.tile(ROW, (12, 1))
    predicted = free_run(HYDRAULIC, parameters, tau, q_des, q, qd, 1)
    following = tau.copy()
    step_batch(HYDRAULIC, parameters, NO_WEIGHTS, following, memory(tau), q_des, q, qd)
    np.testing.assert_array_equal(predicted[1:], following[:-1])


def augmented_rows(**effects):
    """(12, P) the row of `ROW` in joint space, with effects as owner__name=value."""
    k1, k2, k3, k4, r, limit = ROW
    values = {
        "base__k1": k1 * r**2,
        "base__k2": k2,
        "base__k3": k3 * r**2,
        "base__k4": k4 * r,
        "setting__effort_limit": limit,
    }
    row = neutral_row()
    for key, value in {**values, **effects}.items():
        row[slot(*key.split("__"))] = value
    return np.tile(row, (12, 1))


def test_augmented_without_effects_is_the_paper_equation(batch):
    tau, q_des, q, qd = batch
    parameters, remembered = augmented_rows(), np.zeros((*tau.shape, MEMORY))
    tau, expected = np.clip(tau, -800.0, 800.0), np.clip(tau, -800.0, 800.0)
    for _ in range(5):
        step_batch(AUGMENTED, parameters, NO_WEIGHTS, tau, remembered, q_des, q, qd)
        step_batch(HYDRAULIC, np.tile(ROW, (12, 1)), NO_WEIGHTS, expected, memory(tau), q_des, q, qd)
        np.testing.assert_allclose(tau, expected, rtol=1e-9, atol=1e-9)


def test_augmented_rows_do_not_depend_on_the_batch(batch):
    parameters = augmented_rows(command_delay__delay_s=0.003, valve_lag__time_constant_s=0.004, backlash__gap=0.002)
    tau, q_des, q, qd = batch
    one, one_memory, all_memory = tau[7].copy(), np.zeros((12, MEMORY)), np.zeros((*tau.shape, MEMORY))
    for k in range(6):
        step_row(AUGMENTED, parameters, NO_WEIGHTS, one, one_memory, q_des[7] * k, q[7], qd[7])
        step_batch(AUGMENTED, parameters, NO_WEIGHTS, tau, all_memory, q_des * k, q, qd)
    np.testing.assert_array_equal(one, tau[7])
    np.testing.assert_array_equal(one_memory, all_memory[7])


def test_zeroed_memory_forgets_the_past(batch):
    """A delayed command: after the reset the first sample knows no older one."""
    parameters, (tau, q_des, q, qd) = augmented_rows(command_delay__delay_s=0.004), (a[:1] for a in batch)
    start, remembered = 0.1 * tau, np.zeros((1, 12, MEMORY))
    results = []
    for _ in range(2):
        torque = start.copy()
        remembered[:] = 0.0
        for k in range(3):
            step_batch(AUGMENTED, parameters, NO_WEIGHTS, torque, remembered, q_des + 0.01 * k, q, qd)
        results.append(torque)
    np.testing.assert_array_equal(*results)


def test_torque_that_was_not_applied_is_taken_back():
    remembered = np.zeros(MEMORY)
    take_back(AUGMENTED, remembered, 30.0)
    assert remembered[WOUND] == -30.0 and np.count_nonzero(remembered) == 1
    take_back(HYDRAULIC, np.zeros(0), 30.0)


def test_a_kind_with_memory_is_not_stepped_without_it():
    with pytest.raises(ValueError, match="step the others with step_row"):
        step_joint(AUGMENTED, ROW, 0.0, 0.1, 0.0, 0.0)
