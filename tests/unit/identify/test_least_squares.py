"""Fits against closed forms, bounds, and sets against their parts."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from toy_joint import ToyJoint

from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.model import positions
from hqpipe.identify.search import Search, base_solution


def _search(model):
    return Search(model, dict.fromkeys([effect.name for effect in model.effects], -2.0))


def test_linear_fit_is_that_of_the_normal_equations():
    model = ToyJoint(truth={"coulomb_friction": 0.3, "offset": 0.2})
    fitter = Fitter(model)
    free = positions(model, ["coulomb_friction"])
    found = fitter.fit(free, fitter.neutral, 0.0)
    expected = np.linalg.lstsq(model._fit[free].T, model.fit.output, rcond=None)[0]
    assert found.values[free] == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert np.all(found.values[3:] == 0.0)


def test_bounds_hold():
    model = ToyJoint(truth={"coulomb_friction": -0.3})
    fitter = Fitter(model)
    found = fitter.fit(positions(model, ["coulomb_friction"]), fitter.neutral, 0.0)
    assert found.values[2] == 0.0


def test_a_wide_prior_hardly_moves_a_number_and_a_tight_one_does():
    model = ToyJoint(truth={"spring": 0.4})
    fitter = Fitter(model)
    free = positions(model, ["spring"])
    loose, tight = (fitter.fit(free, fitter.neutral, noise).values[4] for noise in (0.01, 1e4))
    assert loose == pytest.approx(0.4, abs=0.01)
    assert abs(tight) < 0.5 * loose


def test_an_overflowing_prediction_is_no_solution():
    class Overflowing(ToyJoint):
        def error(self, values, heldout=False):
            return super().error(values, heldout) * (np.inf if values[2] > 0.1 else 1.0)

    model = Overflowing(truth={"coulomb_friction": 0.3})
    fitter = Fitter(model)
    found = fitter.fit(positions(model, ["coulomb_friction"]), fitter.neutral, 0.0)
    assert np.isfinite(found.square)
    assert found.values[2] <= 0.1


@pytest.mark.parametrize("unknown", [0.0, 0.4])
def test_a_set_is_never_worse_than_its_parts(unknown):
    model = ToyJoint(truth={"coulomb_friction": 0.3, "spring": 0.4}, unknown=unknown, noise=0.3)
    search = _search(model)
    names = [effect.name for effect in model.effects]
    for size in (1, 2, 3):
        for chosen in combinations(names, size):
            known = search.base
            for name in chosen:
                known = search.grown_by(known, name)
            for name in chosen:
                part = search.without(known, name)
                assert known.solution.square <= part.solution.square * (
                    1.0 + 1e-5
                )  # the tolerance of a fit and its prior


def test_base_starts_are_tried():
    class TwoMinima(ToyJoint):
        """An error with a poor minimum near neutral: the offset counts through a cubic."""

        base = (ToyJoint.base[0], type(ToyJoint.base[1])("offset", "N·m", -1.0, np.inf, starts=(-1.0, 1.5)))

        def error(self, values, heldout=False):
            shifted = values.copy()
            shifted[1] = values[1] ** 3 - values[1]
            return super().error(shifted, heldout)

    model = TwoMinima(truth={"offset": 1.5**3 - 1.5})
    assert base_solution(Fitter(model)).values[1] == pytest.approx(1.5, abs=0.01)
