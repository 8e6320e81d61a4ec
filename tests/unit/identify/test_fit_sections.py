"""What differs between sections is told from the scatter of their estimates, on linear problems of known answer."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.identify.normal_equations import NormalEquations
from hqpipe.identify.sections import between_sections, sections_of
from hqpipe.identify.windows import Windows

MEAN = np.array([10.0, 2.0])
FREE, LOWER, UPPER = np.ones(2, bool), np.zeros(2), np.full(2, np.inf)
WINDOWS, ROWS = 50, 20  # of a section; regression rows in a window
CORRELATED = np.array([[0.04, 0.012], [0.012, 0.01]])


def windows(trials, sections):
    """Trials of `sections` times 5 s in windows of 100 ms."""
    count = sections * WINDOWS
    first = np.arange(trials * count) * 100
    return Windows(np.stack([first, first + 100], axis=1), np.repeat(np.arange(trials), count), 100, 1e-3)


def joint(rng, between, cut, noise=0.5, silent=None):
    """Normal equations at their solution of y = X θ, with θ new in every trial and a design that tells both apart."""
    spread = np.linalg.cholesky(between + 1e-300 * np.eye(2))
    theta = MEAN + (spread @ rng.normal(size=(2, cut.trial.max() + 1))).T
    hessians, right = np.empty((len(cut.trial), 2, 2)), np.empty((len(cut.trial), 2))
    for w, trial in enumerate(cut.trial):
        x = rng.normal(size=(ROWS, 2)) + 0.5
        if silent == trial:
            x[:, 1] = 0.0
        y = x @ theta[trial] + noise * rng.normal(size=ROWS)
        hessians[w], right[w] = x.T @ x, x.T @ y
    found = np.linalg.solve(hessians.sum(axis=0), right.sum(axis=0))
    return found, NormalEquations(0.0, hessians, hessians @ found - right)


def estimate(between, joints=30, trials=3, seed=0, shared=False, **options):
    rng, cut = np.random.default_rng(seed), windows(trials, 2)
    made = [joint(rng, between, cut, **options) for _ in range(joints)]
    if shared:
        groups, centres = [sections_of(made, cut, FREE, LOWER, UPPER)], [MEAN]
    else:
        groups = [sections_of([one], cut, FREE, LOWER, UPPER) for one in made]
        centres = [x for x, _ in made]
    return between_sections(groups, centres, [MEAN] * len(groups)) * np.outer(MEAN, MEAN)


def test_the_covariance_between_trials_is_recovered_with_its_correlation():
    np.testing.assert_allclose(estimate(CORRELATED), CORRELATED, rtol=0.4)


def test_joints_that_share_are_compared_with_what_they_share():
    np.testing.assert_allclose(estimate(CORRELATED, shared=True), CORRELATED, rtol=0.4)


def test_equal_sections_show_next_to_nothing():
    found = estimate(np.zeros((2, 2)))
    scatter = 0.5**2 / (WINDOWS * ROWS)  # variance of one section's estimate
    assert (np.diag(found) < 0.3 * scatter).all()


def test_a_trial_that_says_nothing_of_a_parameter_does_not_count():
    np.testing.assert_allclose(estimate(CORRELATED, silent=0, joints=60), CORRELATED, rtol=0.5)


def test_a_single_section_cannot_be_compared():
    rng, cut = np.random.default_rng(0), windows(1, 1)
    x, at = joint(rng, CORRELATED, cut)
    assert between_sections([sections_of([(x, at)], cut, FREE, LOWER, UPPER)], [x], [MEAN]) is None


def test_sections_last_about_five_seconds_and_short_trials_are_left_out():
    bounds = np.arange(150)[:, None] * 100 + np.array([0, 100])
    cut = Windows(bounds, np.repeat([0, 1], [140, 10]), 100, 1e-3)
    x, at = joint(np.random.default_rng(0), np.zeros((2, 2)), cut)
    found = sections_of([(x, at)], cut, FREE, LOWER, UPPER)
    assert [section.trial for section in found] == [0, 0, 0]


def test_estimates_stay_within_their_bounds():
    cut = windows(1, 2)
    x, at = joint(np.random.default_rng(0), CORRELATED, cut)
    tight = sections_of([(x, at)], cut, FREE, x, UPPER)
    assert all((section.value >= x).all() for section in tight)
    assert [s.covariance.shape for s in tight] == [(2, 2)] * 2
    assert tight[0].information == pytest.approx(tight[1].information, rel=0.2)
