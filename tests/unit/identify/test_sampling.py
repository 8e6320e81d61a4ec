"""Correlation times and covariances of noise whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import Parameter, positions
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


class _Shared(ToyJoint):
    """Of viscous friction some share between 0 and 1 may be a tenth of a N·m·s/rad of another kind, which hardly differs."""

    base = (*ToyJoint.base, Parameter("share", "1", 0.0, 1.0, 0.0, 1.0))

    def error(self, values, heldout=False):
        part = self.heldout if heldout else self.fit
        nearly = part.velocity + 0.01 * part.position
        return super().error(np.delete(values, 2), heldout) + 0.1 * values[2] * nearly


def test_a_number_between_bounds_is_no_more_uncertain_than_one_that_is_anywhere_between_them():
    model = _Shared(truth={"viscous_friction": 0.4}, correlation=0.99, noise=0.3)
    fitter = Fitter(model)
    free = positions(model, ["viscous_friction"])
    known = covariance(fitter, fitter.fit(free, [fitter.neutral], 0.0))
    share, friction = 2, 3
    robust, posterior = (np.sqrt(np.diag(matrix)) for matrix in (known.robust, known.posterior))
    assert known.alike > 10.0 and robust[share] > 1.0
    assert posterior[share] == pytest.approx(1.0 / np.sqrt(12.0), rel=0.1)
    assert posterior[friction] < 0.5 * robust[friction], "what stands beside it can only do a tenth"


def test_what_samples_determine_does_not_depend_on_the_prior():
    model = ToyJoint(truth={"viscous_friction": 0.4}, correlation=0.9)
    fitter = Fitter(model)
    known = covariance(fitter, fitter.fit(positions(model, ["viscous_friction"]), [fitter.neutral], 0.0))
    assert known.posterior == pytest.approx(known.robust, rel=0.1, abs=0.02 * np.abs(known.robust).max())
