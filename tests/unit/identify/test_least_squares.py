"""Fits against closed forms, bounds, and sets against their parts."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.base_solution import base_solution
from hqpipe.identify.least_squares import Fitter
from hqpipe.identify.left_out import left_out_error
from hqpipe.identify.model import Effect, Parameter, positions
from hqpipe.identify.rounds import searched
from hqpipe.identify.search import Search


def _search(model):
    return Search(model, dict.fromkeys([effect.name for effect in model.effects], -2.0))


def test_linear_fit_is_that_of_the_normal_equations():
    model = ToyJoint(truth={"coulomb_friction": 0.3, "offset": 0.2})
    fitter = Fitter(model)
    free = positions(model, ["coulomb_friction"])
    found = fitter.fit(free, [fitter.neutral], 0.0)
    expected = np.linalg.lstsq(model._fit[free].T, model.fit.output, rcond=None)[0]
    assert found.values[free] == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert np.all(found.values[3:] == 0.0)


def test_bounds_hold():
    model = ToyJoint(truth={"coulomb_friction": -0.3})
    fitter = Fitter(model)
    found = fitter.fit(positions(model, ["coulomb_friction"]), [fitter.neutral], 0.0)
    assert found.values[2] == 0.0


def test_a_wide_prior_hardly_moves_a_number_and_a_tight_one_does():
    found = {}
    for spread in (0.5, 1e-4):
        model = ToyJoint(truth={"spring": 0.01}, seconds=5.0)
        known = Effect("spring", (Parameter("nm_per_rad", "N·m/rad", 0.0, spread),))
        model.effects = tuple(known if effect.name == "spring" else effect for effect in model.effects)
        fitter = Fitter(model)
        found[spread] = fitter.fit(positions(model, ["spring"]), [fitter.neutral], 0.01).values[4]
    assert found[0.5] == pytest.approx(0.01, abs=0.01)
    assert abs(found[1e-4]) < 0.5 * found[0.5]


def test_the_best_of_several_starts_is_fitted_to_the_end():
    class Wavy(ToyJoint):
        """A spring whose number has several minima."""

        def error(self, values, heldout=False):
            moved = values.copy()
            moved[4] += 0.2 * np.sin(20.0 * values[4])
            return super().error(moved, heldout)

    model = Wavy(truth={"spring": 0.4})
    fitter = Fitter(model)
    free = positions(model, ["spring"])
    starts = []
    for spring in (-0.4, 0.0, 0.45):
        start = fitter.neutral.copy()
        start[4] = spring
        starts.append(start)
    each = [fitter.fit(free, [start], 0.01) for start in starts]
    best = fitter.fit(free, starts, 0.01)
    assert best.square == pytest.approx(min(fit.square for fit in each), rel=1e-6)


def test_an_overflowing_prediction_is_no_solution():
    class Overflowing(ToyJoint):
        def error(self, values, heldout=False):
            return super().error(values, heldout) * (np.inf if values[2] > 0.1 else 1.0)

    model = Overflowing(truth={"coulomb_friction": 0.3})
    fitter = Fitter(model)
    found = fitter.fit(positions(model, ["coulomb_friction"]), [fitter.neutral], 0.0)
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


def test_a_corner_that_the_data_resolve_is_found_however_little_was_known_of_it():
    class Limited(ToyJoint):
        """A drive whose gain, compensation and limit go together, the compensation a tiny part of what it might be."""

        def __init__(self):
            super().__init__()
            spread = 3000.0
            self.base = (
                Parameter("gain", "1", 1.0, np.inf, 0.1, 10.0),
                Parameter("compensation", "1", 0.5, spread, 0.0, 5.0 * spread),
            )
            self.effects = (Effect("flow_saturation", (Parameter("limit", "N·m", 50.0, 40.0, 0.1, 50.0, (4.0,)),)),)

        def error(self, values, heldout=False):
            part, regressors = (self.heldout, self._heldout) if heldout else (self.fit, self._fit)
            return (
                self.law(values, regressors)
                - self.law(np.array([2.0, 0.2, 2.5]), regressors)
                - self.scatter[: len(part.time)]
            )

        def law(self, values, regressors):
            acceleration, speed = regressors[0], regressors[3]
            opening = np.clip(acceleration + values[1] * speed, -values[2], values[2])
            return values[0] * opening - values[0] * values[1] * speed

        scatter = 0.02 * np.random.default_rng(3).standard_normal(10_000)

    found = searched(_search(Limited()), alone=False)
    assert found.names == {"flow_saturation"}
    assert found.solution.values == pytest.approx([2.0, 0.2, 2.5], rel=3e-3)


def test_a_parameter_that_its_bound_stops_does_not_hide_an_effect_that_does_the_same():
    class Late(ToyJoint):
        """An offset that the base may have a little of, and an effect that is more of it."""

        def __init__(self, **numbers):
            super().__init__(**numbers)
            self.base = (ToyJoint.base[0], replace(ToyJoint.base[1], low=-0.1, high=0.1))
            self.effects = (*ToyJoint.effects, Effect("bias", (Parameter("offset", "N·m", 0.0, 1.0),)))

        def error(self, values, heldout=False):
            joined = np.append(values[:1], values[1] + values[-1])
            return super().error(np.concatenate([joined, values[2:-1]]), heldout)

    search = _search(Late(truth={"offset": 2.0}))
    assert [name for _, name in search.screening.screened(search.base, search.addable(frozenset()))][0] == "bias"


def test_what_changes_nothing_stays_where_it_is_and_predicts_as_well():
    class Inert(ToyJoint):
        """A base parameter that cancels, but for rounding."""

        def __init__(self, **numbers):
            super().__init__(**numbers)
            self.base = (*ToyJoint.base, Parameter("cancels", "N·m", 30.0, np.inf))

        def error(self, values, heldout=False):
            kept = np.concatenate([values[:2], values[3:]])
            return (super().error(kept, heldout) + values[2]) - values[2]

    model = Inert(truth={"coulomb_friction": 0.3})
    fitter = Fitter(model)
    found = fitter.fit(positions(model, ["coulomb_friction"]), [fitter.neutral], 0.01)
    assert found.values[2] == 30.0
    assert np.sum(left_out_error(fitter, found) ** 2) == pytest.approx(found.square, rel=0.05)


def test_sensitivities_that_a_model_gives_take_the_place_of_differences():
    class Exact(ToyJoint):
        runs = 0

        def error(self, values, heldout=False):
            self.runs += 1
            return super().error(values, heldout)

        def sensitivity(self, values, index):
            return self._fit[index]

    class Wrapped(Exact):
        """Another model of the same parameters, whose errors are its own."""

        def sensitivity(self, values, index):
            return None

    exact, plain = (kind(truth={"coulomb_friction": 0.3, "spring": 0.2}) for kind in (Exact, Wrapped))
    free = positions(exact, ["coulomb_friction", "spring"])
    found = [(fitter := Fitter(model)).fit(free, [fitter.neutral], 0.0) for model in (exact, plain)]
    assert found[0].values == pytest.approx(found[1].values, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(found[0].jacobian, found[1].jacobian, rtol=1e-6, atol=1e-6)
    assert exact.runs < 0.7 * plain.runs


def test_differences_stay_within_both_bounds_however_long_they_grow():
    class Narrow(ToyJoint):
        """A parameter that changes nothing, so that its step grows, in a range that is shorter than the longest step."""

        base = (*ToyJoint.base, Parameter("idle", "1", 0.3, 1.0, 0.1, 0.6))
        tried = ()

        def error(self, values, heldout=False):
            self.tried += (values[2],)
            return super().error(np.delete(values, 2), heldout)

    model = Narrow(truth={"coulomb_friction": 0.3})
    fitter = Fitter(model)
    for start in (0.1, 0.2, 0.5, 0.6):
        values = fitter.neutral.copy()
        values[2] = start
        fitter.jacobian(values, fitter.error(values), np.array([2]), fitter.long_steps(values, np.array([2])))
    assert min(model.tried) >= 0.1
    assert max(model.tried) == 0.6
