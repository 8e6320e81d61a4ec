"""Three sources of error widen an interval."""

from __future__ import annotations

import numpy as np
import pytest
from toy_joint import ToyJoint

from hqpipe.identify.identify import prior_odds
from hqpipe.identify.intervals import half_widths
from hqpipe.identify.search import Search


def _half(model, name="coulomb_friction"):
    """Half width and value of the first number of an effect that is fitted alone."""
    search = Search(model, prior_odds(model, {}, 0))
    known = search.grown_by(search.base, name)
    search.rank_beside(known)
    place = int(np.flatnonzero(known.solution.free == search.places(name)[0])[0])
    return half_widths(search, known)[place], known.solution.values[search.places(name)[0]]


def test_a_number_that_differs_between_trials_is_less_certain():
    same, other = (ToyJoint(truth={"coulomb_friction": 0.3}, seed=3) for _ in range(2))
    second = other.fit.trial == 1
    other.fit.output[second] += 0.2 * np.sign(other.fit.velocity[second])
    assert _half(other)[0] > 3.0 * _half(same)[0]


@pytest.mark.parametrize("unknown", ["quadratic", "cubic"])
def test_a_law_that_is_wrong_makes_a_number_less_certain(unknown):
    """The shape moves the friction that is fitted without it; the interval holds the true one nevertheless."""
    half, value = _half(ToyJoint(truth={"coulomb_friction": 0.3, unknown: 0.3}, noise=0.02, seed=4))
    assert abs(value - 0.3) < half
    assert half > 2.0 * _half(ToyJoint(truth={"coulomb_friction": 0.3}, noise=0.02, seed=4))[0]


def test_a_prediction_that_overflows_is_not_known_at_all():
    model = ToyJoint(truth={"coulomb_friction": 0.3})
    model.fit.output[:] = np.inf
    search = Search(model, prior_odds(model, {}, 0))
    assert np.isinf(half_widths(search, search.base)).all()
