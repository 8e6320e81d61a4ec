"""Exact sensitivities against finite differences of the simulated window."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.paper_model.window_fit import accumulate, one_step_moments

GAINS = np.array([180.0, 0.03, 10.0, 0.12])


@pytest.fixture
def channels():
    rng = np.random.default_rng(5)
    t = np.arange(400) * 1e-3
    error = 0.05 * np.sin(40 * t) + 0.02 * rng.normal(size=400)
    qd = 2.0 * np.cos(25 * t)
    effort = 300.0 * np.sin(30 * t + 0.5)
    windows = np.array([[k, k + 50] for k in range(0, 350, 50)])
    return effort, error, qd, windows


def evaluate(gains, start, channels, limit=np.inf, outlier=np.inf, start_weight=1.0, weight=None):
    effort, error, qd, windows = channels
    count = len(windows)
    hessian, gradient, cost = np.empty((count, 5, 5)), np.empty((count, 5)), np.empty(count)
    accumulate(
        gains,
        limit,
        effort,
        error,
        qd,
        windows,
        start,
        start_weight,
        outlier,
        hessian,
        gradient,
        cost,
        np.empty(400),
        np.ones(400) if weight is None else weight,
    )
    return hessian, gradient, cost


@pytest.mark.parametrize("limit", [np.inf, 250.0])
@pytest.mark.parametrize("outlier", [np.inf, 40.0])
def test_gradient_is_the_derivative_of_the_cost(channels, limit, outlier):
    start = channels[0][channels[3][:, 0]] + 3.0
    _, gradient, _ = evaluate(GAINS, start, channels, limit, outlier)
    for i in range(5):
        step = 1e-6 * max(GAINS[i] if i < 4 else 300.0, 0.1)
        ahead, behind = (GAINS.copy(), start.copy()), (GAINS.copy(), start.copy())
        for (gains, torque), sign in ((ahead, 1.0), (behind, -1.0)):
            if i < 4:
                gains[i] += sign * step
            else:
                torque += sign * step
        slope = (evaluate(*ahead, channels, limit, outlier)[2] - evaluate(*behind, channels, limit, outlier)[2]) / (
            4 * step
        )
        np.testing.assert_allclose(gradient[:, i], slope, rtol=2e-4, atol=1e-4 * np.abs(slope).max())


def test_hessian_is_the_product_of_the_sensitivities(channels):
    """One window: J from finite differences of the residuals, compared with the accumulated JᵀJ."""
    effort, error, qd, _ = channels
    window = np.array([[100, 130]])
    start = effort[100:101].copy()

    def torques(gains, torque):
        out = []
        for k in range(100, 130):
            h = error[k] * max(-torque * np.sign(error[k]), 0.0)
            torque = gains[0] * error[k] + (1 - gains[1]) * torque - gains[2] * qd[k] + gains[3] * h
            out.append(torque)
        return np.array(out)

    columns = []
    for i in range(4):
        step = 1e-6 * GAINS[i]
        shift = np.eye(4)[i] * step
        columns.append((torques(GAINS + shift, start[0]) - torques(GAINS - shift, start[0])) / (2 * step))
    columns.append((torques(GAINS, start[0] + 1e-4) - torques(GAINS, start[0] - 1e-4)) / 2e-4)
    jacobian = np.array(columns).T
    hessian, _, cost = evaluate(GAINS, start, (effort, error, qd, window), start_weight=0.0)
    np.testing.assert_allclose(hessian[0], jacobian.T @ jacobian, rtol=1e-5)
    assert cost[0] == pytest.approx(np.sum((torques(GAINS, start[0]) - effort[101:131]) ** 2))


def test_start_weight_holds_the_start_to_the_log(channels):
    start = channels[0][channels[3][:, 0]] + 2.0
    light, heavy = (evaluate(GAINS, start, channels, start_weight=w) for w in (0.0, 7.0))
    np.testing.assert_allclose(heavy[2] - light[2], 7.0 * 4.0)
    np.testing.assert_allclose(heavy[1][:, 4] - light[1][:, 4], 7.0 * 2.0)


@pytest.mark.parametrize("span", [1, 5])
def test_moments_solve_noise_free_data_exactly(channels, span):
    _, error, qd, windows = channels
    effort = np.zeros(400)
    for k in range(399):
        h = error[k] * max(-effort[k] * np.sign(error[k]), 0.0)
        effort[k + 1] = GAINS[0] * error[k] + (1 - GAINS[1]) * effort[k] - GAINS[2] * qd[k] + GAINS[3] * h
    moments, right = one_step_moments(effort, error, qd, np.ones(400), windows, span)
    np.testing.assert_allclose(np.linalg.solve(moments, right), GAINS, rtol=1e-6)


def test_samples_that_were_not_recorded_count_for_nothing(channels):
    effort, error, qd, windows = channels
    weight = np.ones(400)
    weight[[7, 60, 61, 333]] = 0.0
    gains, start = GAINS, effort[windows[:, 0]]
    plain = evaluate(gains, start, (effort, error, qd, windows), weight=weight)
    effort = np.where(weight > 0.0, effort, 1e6)
    for a, b in zip(plain, evaluate(gains, start, (effort, error, qd, windows), weight=weight), strict=True):
        np.testing.assert_array_equal(a, b)
    assert evaluate(gains, start, (effort, error, qd, windows))[2].sum() > 1e9


@pytest.mark.parametrize("outlier", [np.inf, 40.0])
def test_a_sample_of_weight_two_counts_twice(channels, outlier):
    start = channels[0][channels[3][:, 0]]
    once, twice = (evaluate(GAINS, start, channels, outlier=outlier, weight=np.full(400, w)) for w in (1.0, 2.0))
    held = evaluate(GAINS, start, channels, outlier=outlier, weight=np.zeros(400))  # the start alone
    for a, b, c in zip(once, twice, held, strict=True):
        np.testing.assert_allclose(b - c, 2.0 * (a - c), rtol=1e-12)
