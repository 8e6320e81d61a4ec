"""Four sources of error widen an interval."""

from __future__ import annotations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.beside import rank_beside
from hqpipe.identify.change import _joined
from hqpipe.identify.intervals import _between, half_widths
from hqpipe.identify.model import STATES, Effect, Parameter
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search


def _half(model, name="coulomb_friction"):
    """Half width and value of the first number of an effect that is fitted alone."""
    search = Search(model, prior_odds(model, {}, 0))
    known = search.grown_by(search.base, name)
    rank_beside(search, known)
    place = int(np.flatnonzero(known.solution.free == search.screening.places(name)[0])[0])
    return half_widths(search, known)[place], known.solution.values[search.screening.places(name)[0]]


def test_a_number_that_differs_between_trials_is_less_certain():
    same, other = (ToyJoint(truth={"coulomb_friction": 0.3}, seed=3) for _ in range(2))
    second = other.fit.trial == 1
    other.fit.output[second] += 0.2 * np.sign(other.fit.velocity[second])
    assert _half(other)[0] > 3.0 * _half(same)[0]


def _resting(model, *trials):
    """The joint, at rest in some of its trials."""
    for trial in trials:
        rows = model.fit.trial == trial
        model._fit[:, rows] = 0.0
        model.fit.output[rows] = model.noise[0] * np.random.default_rng(trial).standard_normal(rows.sum())
    return model


def _of_four_trials(**kwargs):
    one, two = (ToyJoint(truth={"coulomb_friction": 0.3}, seed=seed, **kwargs) for seed in (3, 4))
    one.fit, one._fit = _joined(one.fit, two.fit), np.concatenate([one._fit, two._fit], axis=1)
    return one


def test_a_number_that_one_trial_alone_shows_is_as_sure_as_that_trial_makes_it():
    """Fits without it say nothing of the number: where they leave it is no scatter."""
    model = _resting(_of_four_trials(), 1, 2, 3)
    half, value = _half(model)
    assert value == pytest.approx(0.3, abs=0.02) and half < 0.03
    search = Search(model, prior_odds(model, {}, 0))
    known = search.grown_by(search.base, "coulomb_friction")
    place = int(np.flatnonzero(known.solution.free == search.screening.places("coulomb_friction")[0])[0])
    assert _between(search.fitter, known)[place, place] == pytest.approx(0.0, abs=1e-24)


def test_a_number_that_some_trials_show_scatters_as_it_does_among_these():
    wide, narrow = (_resting(_of_four_trials(), 2, 3) for _ in range(2))
    second = wide.fit.trial == 1
    wide.fit.output[second] += 0.2 * np.sign(wide.fit.velocity[second])
    assert _half(wide)[0] > 3.0 * _half(narrow)[0]
    assert _half(narrow)[0] < 0.2, "two trials agree, and the others have no say"


@pytest.mark.parametrize("unknown", ["quadratic", "cubic"])
def test_a_law_that_is_wrong_makes_a_number_less_certain(unknown):
    """The shape moves the friction that is fitted without it; the interval holds the true one nevertheless."""
    half, value = _half(ToyJoint(truth={"coulomb_friction": 0.3, unknown: 0.3}, noise=0.02, seed=4))
    assert abs(value - 0.3) < half
    assert half > 2.0 * _half(ToyJoint(truth={"coulomb_friction": 0.3}, noise=0.02, seed=4))[0]


def test_a_number_that_holds_what_another_effect_does_is_as_uncertain_as_that_makes_it():
    """Of two effects that do nearly the same, as a delay and a lag, an answer may name one with what both do together."""
    model = ToyJoint(truth={"viscous_friction": 0.4, "spring": 0.03}, noise=0.02, seed=4)
    whole = model.error
    seal = Effect("seal", (Parameter("nm_s_per_rad", "N·m·s/rad", 0.0, 0.5),))
    model.effects = (*(effect for effect in model.effects if effect.name != "spring"), seal)

    def error(values, heldout=False):
        part = model.heldout if heldout else model.fit
        return whole(np.insert(values[:-1], 4, 0.0), heldout) + values[-1] * (part.velocity + 0.1 * part.position)

    model.error = error
    half, value = _half(model, "viscous_friction")
    assert value == pytest.approx(0.4, abs=0.01)
    assert value - half < 0.1, "the seal has 0.3 of it, and the spring of the truth with that"


def test_a_prediction_that_overflows_is_not_known_at_all():
    model = ToyJoint(truth={"coulomb_friction": 0.3})
    model.fit.output[:] = np.inf
    search = Search(model, prior_odds(model, {}, 0))
    assert np.isinf(half_widths(search, search.base)).all()


def test_a_law_that_is_missing_may_have_been_taken_up_by_a_number():
    """Of unknown functions of the state, another in each machine, the interval allows for what the fit takes up of them."""
    covered, halves = 0, []
    for draw in range(30):
        model = ToyJoint(truth={"coulomb_friction": 0.3}, seed=3)
        model.fit.output[:] += np.random.default_rng(draw).normal(0.0, 0.1, STATES)[model.fit.state]
        half, value = _half(model)
        covered += abs(value - 0.3) <= half
        halves.append(half)
    assert covered >= 27
    assert np.median(halves) < 0.15, "an interval that holds everything says nothing"
