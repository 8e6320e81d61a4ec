"""The compiled actuator models against the paper's equation, written out once more in plain numpy."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.kernels.actuator_step import HYDRAULIC, PD, step_batch, step_joint, step_row
from hqpipe.kernels.free_run import free_run

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
    step_batch(HYDRAULIC, parameters, tau, q_des, q, qd)
    np.testing.assert_allclose(tau, expected, rtol=1e-12)


def test_pd_batch_is_a_clipped_pd_law(batch):
    tau, q_des, q, qd = batch
    parameters = np.tile([6000.0, 200.0, 500.0], (12, 1))
    step_batch(PD, parameters, tau, q_des, q, qd)
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
    step_row(kind, parameters, one, q_des[0], q[0], qd[0])
    step_batch(kind, parameters, tau, q_des, q, qd)
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
    step_batch(HYDRAULIC, parameters, following, q_des, q, qd)
    np.testing.assert_array_equal(predicted[1:], following[:-1])
