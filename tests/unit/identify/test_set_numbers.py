"""How sure the numbers of a set are: as the intervals say, within what was known beforehand."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint
from scipy.stats import norm

from hqpipe.identify.beside import rank_beside
from hqpipe.identify.identify import identify
from hqpipe.identify.intervals import half_widths
from hqpipe.identify.joint_moves import Step
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.model import LayerJoints
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search
from hqpipe.identify.set_numbers import base_numbers, set_numbers

Z = norm.ppf(0.975)
FRICTION = {"coulomb_friction": 0.3, "viscous_friction": 0.2}


def searched(model, *names):
    search = Search(model, prior_odds(model, {}, 0))
    known = search.base
    for name in names:
        known = search.grown_by(known, name)
    rank_beside(search, known)
    return search, known


def test_deviations_are_those_of_the_intervals_and_numbers_are_correlated():
    search, known = searched(ToyJoint(truth=FRICTION, correlation=0.9, seed=2), *FRICTION)
    numbers = set_numbers(search, known)
    deviations = np.sqrt(np.diag(numbers.covariance))
    np.testing.assert_allclose(Z * deviations, half_widths(search, known), rtol=1e-9)
    assert np.linalg.eigvalsh(numbers.covariance / np.outer(deviations, deviations)).min() > -1e-9
    dry, viscous = (np.flatnonzero(numbers.free == search.screening.places(name)[0])[0] for name in FRICTION)
    correlation = numbers.covariance[dry, viscous] / (deviations[dry] * deviations[viscous])
    assert correlation < -0.5, "more of one friction is less of the other"


def test_the_covariance_is_that_of_fits_to_other_noise():
    values, found = [], []
    for seed in range(60):
        model = ToyJoint(truth={"coulomb_friction": 0.3}, seed=7, seconds=5.0)
        model.fit.output[:] += np.random.default_rng(seed).normal(0.0, 0.3, len(model.fit.output))
        search, known = searched(model, "coulomb_friction")
        values.append(known.solution.values[known.solution.free])
        found.append(np.sqrt(np.diag(set_numbers(search, known).covariance)))
    scatter = np.std(values, axis=0)
    assert (np.median(found, axis=0) > 0.7 * scatter).all(), "Student factors of two trials make it wider, not narrower"


def test_what_the_logs_do_not_determine_varies_by_its_usual_size():
    """Two trials that contradict each other make the interval of a spring as wide as a Student factor says."""
    model = ToyJoint(seed=3)
    second = model.fit.trial == 1
    model.fit.output[second] += 40.0 * model.fit.position[second]
    model.fit.output[~second] -= 40.0 * model.fit.position[~second]
    search, known = searched(model, "spring")
    numbers = set_numbers(search, known)
    place = int(np.flatnonzero(numbers.free == search.screening.places("spring")[0])[0])
    spread = search.fitter.spread[search.screening.places("spring")[0]]
    value = numbers.values[search.screening.places("spring")[0]]
    assert half_widths(search, known)[place] > 5.0 * spread
    assert np.sqrt(numbers.covariance[place, place]) == pytest.approx(max(spread, abs(value)))


def test_a_coefficient_without_prior_varies_by_a_share_of_itself():
    """An inertia that two trials tell four times as large and not at all."""
    model = ToyJoint(truth={"inertia": 2.0}, seed=6)
    acceleration = model._fit[0]
    model.fit.output[:] += np.where(model.fit.trial == 1, 2.0, -2.0) * acceleration
    search, known = searched(model)
    numbers = set_numbers(search, known)
    inertia, offset = np.sqrt(np.diag(numbers.covariance))
    assert half_widths(search, known)[0] > numbers.values[0]
    assert inertia == pytest.approx(0.3 * numbers.values[0])
    assert offset == pytest.approx(half_widths(search, known)[1] / Z), "it may have either sign"


def test_a_prediction_that_overflows_says_nothing():
    model = ToyJoint()
    model.fit.output[:] = np.inf
    assert base_numbers(model) is None


def test_each_exchange_has_numbers_of_its_own():
    model = ToyJoint(truth={"viscous_friction": 0.3}, seed=4)
    search = JointSearch(model, prior_odds)
    search.first(True)
    search.answered()
    steps = [Step("viscous_friction", other) for other in ("coulomb_friction", "no such effect", "viscous_friction")]
    own, exchanged = search.numbers(frozenset({"viscous_friction"}), [*steps, Step("spring", "coulomb_friction")])
    assert own.values[3] == pytest.approx(0.3, abs=0.02) and own.values[2] == 0.0
    (numbers,) = exchanged.values()
    assert list(exchanged) == steps[:1] and numbers.values[3] == 0.0 and numbers.values[2] > 0.1
    assert set(numbers.free) == {0, 1, 2}


def test_an_answer_says_it_where_it_is_asked():
    joints = LayerJoints("toy", "rmse", 0.1, "toy", (ToyJoint(truth={"viscous_friction": 0.3}, seed=5),))
    (asked,), (plain,) = (identify(joints, covariances=ask).found for ask in (True, False))
    assert plain.numbers is None and [c.effect for c in asked.causes] == [c.effect for c in plain.causes]
    np.testing.assert_array_equal(asked.numbers.values, asked.named.values)
    (cause,) = asked.causes
    half = Z * np.sqrt(np.diag(asked.numbers.covariance))[list(asked.numbers.free).index(3)]
    (number,) = cause.numbers
    np.testing.assert_allclose([number.value - half, number.value + half], number.ci95, rtol=1e-9)
