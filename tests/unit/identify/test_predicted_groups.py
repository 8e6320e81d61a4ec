"""Predicted errors of groups against fits without them."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.left_out import groups, left_out_error
from hqpipe.identify.model import positions


@pytest.mark.parametrize("effects", [(), ("coulomb_friction", "spring")])
def test_it_is_what_refits_give_where_the_model_is_linear(effects):
    model = ToyJoint(truth={"coulomb_friction": 0.3}, unknown=0.2)
    fitter = Fitter(model)
    free = positions(model, list(effects))
    solution = fitter.fit(free, [fitter.neutral], 0.0)
    total = 0.0
    number = groups(model.fit)
    for group in np.unique(number):
        rest = number != group
        values = np.linalg.lstsq(model._fit[free][:, rest].T, model.fit.output[rest], rcond=None)[0]
        total += np.sum((values @ model._fit[free][:, ~rest] - model.fit.output[~rest]) ** 2)
    assert np.sum(left_out_error(fitter, solution) ** 2) == pytest.approx(total, rel=1e-3)


def test_every_group_has_parts_of_every_trial():
    samples = ToyJoint().fit
    number = groups(samples)
    for group in np.unique(number):
        assert set(samples.trial[number == group]) == {0, 1}
    assert np.bincount(number).max() <= 1.01 * np.bincount(number).min()


def test_a_useless_number_predicts_worse():
    wins = 0
    for seed in range(20):
        model = ToyJoint(seed=seed, correlation=0.95)
        fitter = Fitter(model)
        base, more = (fitter.fit(positions(model, names), [fitter.neutral], 0.0) for names in ([], ["spring", "cubic"]))
        wins += np.sum(left_out_error(fitter, base) ** 2) < np.sum(left_out_error(fitter, more) ** 2)
    assert wins >= 14
