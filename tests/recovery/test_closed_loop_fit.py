"""Trotting legs of known k1 … k4 with impacts and real sensors: estimates, intervals and posterior hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from closed_loop_truth import Sensors, trot
from hydraulic_truth import RADIUS, TRUTH, log_set, simulate

from hqpipe.identify.paper_model.fit_actuator import fit_actuator

KNOWN = np.array(list(TRUTH.values()))


def table(result, pick):
    return np.array([[pick(c) for c in fit.coefficients] for fit in result.fits])


def test_known_coefficients_are_recovered_within_two_percent():
    """20 s with noise on torque, position and velocity, and the steps of the encoder."""
    logs = log_set([trot(20.0, 4, 7, Sensors(drift=0.0))], ["fit"])
    for scope in ("per_joint", "shared"):
        value = table(fit_actuator(logs, sprocket_radius=RADIUS, scope=scope), lambda c: c.value)
        np.testing.assert_allclose(value / np.broadcast_to(KNOWN, value.shape), 1.0, atol=0.02)


def test_intervals_hold_under_correlated_disturbances():
    """Of 40 fits 95 % intervals miss more than 7 once in 1,400 times; ones for independent residuals miss 25 and more."""
    result = fit_actuator(log_set([trot(10.0, 40, 5)], ["fit"]), sprocket_radius=RADIUS)
    value = table(result, lambda c: c.value)
    low, high = table(result, lambda c: c.ci95[0]), table(result, lambda c: c.ci95[1])
    hits = ((low <= KNOWN) & (KNOWN <= high)).sum(axis=0)
    assert (hits >= 33).all(), hits
    width = np.sqrt(((high - low) ** 2).mean(axis=0)) / (2.0 * 1.96 * value.std(axis=0))
    assert (width < 1.6).all(), "intervals must not be wide for safety's sake"


def machines(rng, trials):
    """(trials, 4, 6) coefficients of six joints that are others in every trial, by 6 %."""
    return KNOWN[:, None] * (1.0 + 0.06 * rng.normal(size=(trials, 4, 6)))


@pytest.fixture(scope="module")
def changing():
    """The fit to four trials of such a machine."""
    trials = [trot(5.0, 6, [3, i], truth=truth) for i, truth in enumerate(machines(np.random.default_rng(3), 4))]
    return fit_actuator(log_set(trials, ["fit"] * 4), sprocket_radius=RADIUS)


def test_posterior_finds_what_differs_between_trials(changing):
    for group in changing.posterior.groups:
        assert group.sections == 4
        share = np.sqrt(np.diag(group.between)) / group.mean
        np.testing.assert_allclose(share[:3], 0.06, rtol=0.35)
        assert 0.02 < share[3] < 0.12


def test_draws_cover_trials_that_the_fit_has_not_seen(changing):
    unseen = machines(np.random.default_rng(4), 200).transpose(0, 2, 1)
    drawn = changing.posterior.draw(changing.model, 2000, np.random.default_rng(0))[..., :4]
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    assert 0.90 < ((low <= unseen) & (unseen <= high)).mean() < 0.985
    low, high = table(changing, lambda c: c.ci95[0]), table(changing, lambda c: c.ci95[1])
    covered = ((low <= unseen) & (unseen <= high)).mean(axis=(0, 1))
    assert (covered[:3] < 0.6).all(), "intervals of the estimate are not what another trial gives"


def test_draws_keep_the_correlation_of_the_estimate():
    result = fit_actuator(log_set([trot(20.0, 1, 2)], ["fit"]), sprocket_radius=RADIUS)
    group = result.posterior.groups[0]
    drawn = result.posterior.draw(result.model, 4000, np.random.default_rng(0))[:, 0, :4]
    expected = group.covariance / np.sqrt(np.outer(np.diag(group.covariance), np.diag(group.covariance)))
    np.testing.assert_allclose(np.corrcoef(drawn.T), expected, atol=0.06)
    assert expected[0, 2] > 0.4, "k1 and k3 rise together"


def test_k4_without_impacts_is_drawn_from_the_assumed_range():
    logs = log_set([simulate(6.0, 2, 1.0, 8, motion=0.005, knocks=0.0)], ["fit"])
    result = fit_actuator(logs, sprocket_radius=RADIUS)
    k4 = result.posterior.draw(result.model, 500, np.random.default_rng(0))[..., 3]
    for j, group in enumerate(result.posterior.groups):
        span = group.ranges["k4"]
        assert span.low == 0.0 and "an impact at most doubles the leakage" in span.reason
        error = np.abs(logs.fit[0].trajectory.position_command - logs.fit[0].trajectory.position)[:, j].max()
        assert span.high * RADIUS * error == pytest.approx(result.model.column("k2")[j])
        assert k4[:, j].max() == pytest.approx(span.high, rel=0.02) and k4[:, j].min() >= 0.0


def test_k4_without_impacts_is_taken_from_joints_that_have_them():
    quiet, knocked = (simulate(6.0, 1, 1.0, 8, motion=m, knocks=k) for m, k in ((0.005, 0.0), (0.35, 400.0)))
    both = [np.concatenate([a, b], axis=1) for a, b in zip(quiet[1:], knocked[1:], strict=True)]
    result = fit_actuator(log_set([(quiet[0], *both)], ["fit"]), sprocket_radius=RADIUS)
    span = result.posterior.groups[0].ranges["k4"]
    assert (span.low, span.high) == (0.0, result.fits[1]["k4"].value)
