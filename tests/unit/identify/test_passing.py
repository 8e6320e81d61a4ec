"""Effects that act in one stretch of each trial."""

from __future__ import annotations

import re

import numpy as np
import pytest
from identify.toy_joint import DT, ToyJoint

from hqpipe.identify import identify as engine
from hqpipe.identify.identify import identify
from hqpipe.identify.model import Effect, LayerJoints, Parameter, Samples, all_parameters
from hqpipe.identify.passing import PassingJoint
from hqpipe.identify.stretches import Shown, inside, most_contrast, stretches_of

SECONDS, WINDOW = 21.0, 0.1
SPAN = (7.0, 14.0)
STRETCHES = ({"a": SPAN, "b": SPAN}, {"c": SPAN})


class PassingToy(ToyJoint):
    """A joint with one effect that acts in one stretch of each trial, the middle third if none is given."""

    def __init__(self, effect, size, files=("a", "b", "c"), span=SPAN, **settings):
        super().__init__(seconds=SECONDS, **settings)
        place = [parameter.name for parameter in self.base] + [candidate.name for candidate in self.effects]
        for part, regressors in ((self.fit, self._fit), (self.heldout, self._heldout)):
            here = inside(part, {file: span for file in part.files if file in files}, DT)
            part.output[:] += np.where(here, size * regressors[place.index(effect)], 0.0)


def _found(*models):
    return identify(LayerJoints("joint_motion", "rmse", WINDOW, "", tuple(models))).found


def test_an_effect_in_the_middle_of_each_trial_is_found_with_its_number_and_its_times():
    (joint,) = _found(PassingToy("coulomb_friction", 0.4, noise=0.05))
    (cause,) = joint.causes
    assert cause.effect == "coulomb_friction"
    assert cause.numbers[0].value == pytest.approx(0.4, rel=0.05)
    assert isinstance(joint.model, PassingJoint)
    note = joint.model.notes[-1]
    start, end = (float(number) for number in re.findall(r"([\d.]+) to ([\d.]+) s of c", note)[0])
    assert (start, end) == (pytest.approx(SPAN[0], abs=WINDOW), pytest.approx(SPAN[1], abs=WINDOW))
    assert np.sqrt(np.mean(joint.named.heldout**2)) < 1.1 * joint.model.noise[1]


def test_an_effect_that_acts_for_two_thirds_of_the_time_is_no_lasting_one_of_two_thirds_of_its_size():
    model = PassingToy("coulomb_friction", 0.4, span=(5.0, 19.0), noise=0.05)
    (joint,) = _found(model)
    assert isinstance(joint.model, PassingJoint)
    assert joint.causes[0].numbers[0].value == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("effect", ["coulomb_friction", "spring"])
def test_an_effect_over_the_whole_trial_stays_lasting(effect):
    model = ToyJoint(truth={effect: 0.4}, noise=0.05)
    (joint,) = _found(model)
    assert joint.model is model
    assert [cause.effect for cause in joint.causes] == [effect]


@pytest.mark.parametrize("unknown", [0.0, 0.3])
def test_what_no_effect_describes_at_any_time_gets_no_time(unknown):
    model = ToyJoint(truth={} if unknown else {"cubic": 0.5}, unknown=unknown, noise=0.05)
    (joint,) = _found(model)
    assert joint.model is model
    assert not joint.causes


def test_what_passes_in_one_of_the_fit_trials_alone_gets_no_time():
    model = PassingToy("coulomb_friction", 0.4, files=("a",), noise=0.05)
    assert _found(model)[0].model is model


def test_a_joint_that_shows_nothing_keeps_its_model_beside_one_that_does():
    clean = ToyJoint("knee", noise=0.05, seconds=SECONDS, seed=1)
    other, one = _found(clean, PassingToy("viscous_friction", 0.3, noise=0.05))
    assert other.model is clean and not other.causes
    assert [cause.effect for cause in one.causes] == ["viscous_friction"]


def test_neutral_effects_give_the_error_of_the_base():
    model = PassingToy("spring", 0.4)
    passing = PassingJoint(model, *STRETCHES, 0.0)
    values = np.array([parameter.neutral for parameter in all_parameters(model)])
    values[:2] = 1.1, 0.02
    for heldout in (False, True):
        np.testing.assert_array_equal(passing.error(values, heldout), model.error(values, heldout))


def test_outside_the_stretch_the_effects_are_absent_and_inside_the_error_is_that_of_the_joint():
    model = PassingToy("spring", 0.4)
    passing = PassingJoint(model, *STRETCHES, 0.0)
    values = np.array([1.1, 0.02, 0.2, 0.1, 0.3, 0.0, 0.0])
    base = np.append(values[:2], np.zeros(5))
    here = (model.fit.time >= SPAN[0] + DT) & (model.fit.time < SPAN[1])
    error = passing.error(values)
    np.testing.assert_array_equal(error[here], model.error(values)[here])
    away = (model.fit.time < SPAN[0]) | (model.fit.time > SPAN[1])
    np.testing.assert_array_equal(error[away], model.error(base)[away])


def test_fit_samples_near_the_ends_of_a_stretch_are_left_out():
    model = PassingToy("spring", 0.4)
    passing = PassingJoint(model, *STRETCHES, WINDOW)
    assert np.min(np.abs(passing.fit.time[:, None] - np.array(SPAN))) >= WINDOW - 1e-9
    assert len(model.fit.time) - len(passing.fit.time) == pytest.approx(2 * 4 * WINDOW / DT, abs=5)
    values = np.array([1.1, 0.02, 0.2, 0.1, 0.3, 0.0, 0.0])
    assert len(passing.error(values)) == len(passing.fit.time)
    assert len(passing.error(values, True)) == len(model.heldout.time)


def test_the_base_is_not_evaluated_again_along_effects():
    model = PassingToy("spring", 0.4)
    asked = []
    error = model.error
    model.error = lambda values, heldout=False: (asked.append(values.copy()), error(values, heldout))[1]
    passing = PassingJoint(model, *STRETCHES, 0.0)
    for size in (0.1, 0.2, 0.3):
        passing.error(np.array([1.0, 0.0, size, 0.0, 0.0, 0.0, 0.0]))
    assert len(asked) == 4
    first = passing.error(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    first[:] = 0.0  # what is handed out is not what is kept
    assert np.any(passing.error(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])))


def test_what_the_machine_does_to_a_joint_acts_always():
    model = PassingToy("spring", 0.4)
    model.effects = (
        *model.effects[:4],
        Effect("quadratic", (Parameter("size", "1", 0.0, 0.5),), named=False, context=True),
    )
    values = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.3])
    np.testing.assert_array_equal(PassingJoint(model, *STRETCHES, 0.0).error(values), model.error(values))


def test_optional_attributes_are_those_of_the_joint():
    model = ToyJoint()
    model.unsigned = True
    passing = PassingJoint(model, *STRETCHES, 0.0)
    assert passing.unsigned and passing.base is model.base
    assert not hasattr(passing, "remarks")


def test_nothing_is_searched_where_all_is_explained(monkeypatch):
    calls = []
    searched = engine._searched
    monkeypatch.setattr(engine, "_searched", lambda models, *rest: (calls.append(models), searched(models, *rest))[1])
    _found(ToyJoint(), ToyJoint("knee", truth={"spring": 0.5}, seed=1))
    assert len(calls) == 1


def test_the_blocks_that_stand_out_most_are_found():
    height = np.zeros(100)
    height[30:55] = 1.0
    assert most_contrast(height) == (30, 55)
    assert most_contrast(np.zeros(100)) is None
    assert most_contrast(np.ones(6)) is None


def test_a_joint_that_is_not_judged_for_a_time_says_nothing_of_it():
    time = np.arange(1, 2001) * DT
    error = np.where((time > 3.0) & (time < 6.0), 1.0, 0.1)

    def shown(kept):
        zero = np.zeros(int(kept.sum()))
        samples = Samples(("a",), zero.astype(int), time[kept], zero, zero, zero, zero)
        return Shown(samples, error[kept], 0.01, DT)

    whole = shown(np.ones(2000, dtype=bool))
    (found,) = stretches_of([whole, shown((time < 1.0) | (time > 2.0))], WINDOW).values()
    assert found == pytest.approx((3.0, 6.0), abs=WINDOW)


def test_ends_are_found_within_a_tenth_of_a_window():
    time = np.arange(1, 2001) * DT
    error = np.random.default_rng(0).normal(0.0, np.where((time > 3.04) & (time <= 6.17), 1.0, 0.1))
    zero = np.zeros(len(time))
    samples = Samples(("a",), zero.astype(int), time, zero, zero, zero, zero)
    assert stretches_of([Shown(samples, error, 0.01, DT)], WINDOW)["a"] == pytest.approx((3.04, 6.17), abs=0.011)
    assert stretches_of([Shown(samples, error[::-1], 0.01, DT)], WINDOW)["a"] == pytest.approx((3.83, 6.96), abs=0.011)
