"""Correlation times and covariances of noise whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import positions
from hqpipe.identify.sampling import blocks, covariance


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_correlation_time_of_a_first_order_process(rho):
    model = ToyJoint(correlation=rho, seconds=200.0)
    error = model.error(np.array([1.0, 0, 0, 0, 0, 0, 0]))
    assert correlation_time(error, model.fit) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_blocks_do_not_cross_trials():
    model = ToyJoint()
    number = blocks(model.fit, 300.0)
    assert len(np.unique(number)) == number.max() + 1
    for block in np.unique(number):
        assert len(set(model.fit.trial[number == block])) == 1


def test_robust_covariance_is_the_scatter_over_repeats():
    rho, found, claimed = 0.95, [], []
    for seed in range(60):
        model = ToyJoint(correlation=rho, seed=seed)
        fitter = Fitter(model)
        solution = fitter.fit(positions(model, ["coulomb_friction"]), [fitter.neutral], 0.0)
        known = covariance(fitter, solution)
        found.append(solution.values[1])
        claimed.append((known.robust[1, 1], known.naive[1, 1]))
    robust, naive = np.sqrt(np.mean(claimed, axis=0))
    assert robust == pytest.approx(np.std(found), rel=0.35)
    assert naive < 0.5 * np.std(found)
