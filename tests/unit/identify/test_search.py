"""Steps of the search that single additions and removals would not find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from identify.toy_joint import ToyJoint

from hqpipe.identify.prior import prior_odds
from hqpipe.identify.rounds import forward_then_backward, searched
from hqpipe.identify.search import Search
from hqpipe.identify.worth_keeping import worth_keeping


def search_of(joint):
    return Search(joint, prior_odds(joint, {}, 0))


def test_effects_that_go_one_by_one_are_not_all_let_go(monkeypatch):
    """Each removal makes the error larger, so that it says less of the next one."""
    search = search_of(ToyJoint(truth={"coulomb_friction": 0.3, "spring": 0.5}))
    best = search.grown(search.base)
    assert best.names == {"coulomb_friction", "spring"}
    monkeypatch.setattr(search, "gain", lambda large, small: 5.0 if len(large.names) - len(small.names) > 1 else -1.0)
    monkeypatch.setattr(search, "replaced", lambda smaller, name: [])
    assert search.improved(best).names == {"spring"}


class Imitated(ToyJoint):
    """Friction and spring, and a candidate that does what both of them do and a little else."""

    effects = tuple(
        effect for effect in ToyJoint.effects if effect.name in ("coulomb_friction", "viscous_friction", "spring")
    )

    def _part(self, files, truth, *others):
        samples, regressors = super()._part(files, {}, *others)
        both = 0.3 * regressors[2] + 0.5 * regressors[4]
        regressors = regressors[:5].copy()
        regressors[3] = both + 0.03 * regressors[3] ** 2
        return replace(samples, output=samples.output + both), regressors


def test_one_effect_in_the_place_of_two_gives_way_to_both(monkeypatch):
    joint = Imitated()
    search = search_of(joint)
    one = search.begun_at({"viscous_friction": np.ones(1)})
    smaller = search.without(one, "viscous_friction")
    assert all(search.preference(option, one) < 0.0 for option in search.replaced(smaller, "viscous_friction"))
    assert search.improved(one).names == one.names
    joint.begin = one.names, one.solution.values
    monkeypatch.setattr(Search, "grown", lambda search, best: best)
    assert searched(search_of(joint), alone=False).names == {"coulomb_friction", "spring"}


def test_rivals_do_what_the_effect_does_however_much_others_promise():
    joint = ToyJoint(truth={"viscous_friction": 0.3, "spring": 2.0, "cubic": 2.0})
    search = search_of(joint)
    known = search.begun_at({"viscous_friction": np.full(1, 0.3)})
    smaller = search.without(known, "viscous_friction")
    others = [name for name in search.addable(smaller.names) if name != "viscous_friction"]
    assert {name for _, name in search.screening.screened(smaller, others)[:2]} == {"spring", "cubic"}
    tried = {next(iter(option.names)) for option in search.rivals(smaller, "viscous_friction")}
    assert tried == {"coulomb_friction", "quadratic"}


def test_what_does_nothing_has_no_rival():
    search = search_of(ToyJoint())
    known = replace(search.base, names=frozenset({"spring"}))
    assert search.screening.in_place(known, ["spring"], ["viscous_friction"]) == []


def test_where_the_fit_went_without_an_effect_says_nothing_of_its_rivals():
    """Without it, the base may end where its slopes imitate what a rival does."""
    search = search_of(ToyJoint(truth={"viscous_friction": 0.3}))
    known = search.begun_at({"viscous_friction": np.full(1, 0.3)})
    smaller = search.without(known, "viscous_friction")
    quadratic = search.model._fit[-1]
    jacobian = np.stack([*smaller.solution.jacobian.T[:-1], quadratic], axis=1)
    astray = replace(smaller, solution=replace(smaller.solution, jacobian=jacobian))
    search.known[smaller.names] = astray
    promised = [gain for gain, _ in search.screening.screened(astray, ["quadratic"])]
    assert max(promised, default=0.0) < 1e-6 * known.solution.square
    for tried in (search.rivals(astray, "viscous_friction"), search.replaced(astray, "viscous_friction")):
        assert "quadratic" in {next(iter(option.names)) for option in tried}


def test_a_vibration_asks_no_more_of_a_cause():
    """No effect could have described what is faster than effects act: the joint is as well explained without it."""
    joint = ToyJoint(truth={"viscous_friction": 0.3})
    search = search_of(joint)
    known = search.begun_at({"viscous_friction": np.full(1, 0.3)})
    square = search.left_out(known)
    assert search.in_reach(known, square) > 0.98 * square  # noise alone is no vibration
    vibration = 8.0 * np.sin(2.0 * np.pi * 80.0 * joint.fit.time)
    joint.fit = replace(joint.fit, output=joint.fit.output + vibration)
    search = search_of(joint)
    known = search.begun_at({"viscous_friction": np.full(1, 0.3)})
    assert search.left_out(known) > 100.0 * square
    assert 0.5 * square < search.in_reach(known, search.left_out(known)) < 2.0 * square
    assert searched(search, alone=False).names == {"viscous_friction"}
    assert worth_keeping(search, known, search.base)[0].names == {"viscous_friction"}


class AskedTogether(Search):
    """Friction and spring are each improbable without the other one, and probable together."""

    worth = 5.0

    def gain(self, large, small, overstated=1.0):
        return self._worth_of(large) - self._worth_of(small)

    def _worth_of(self, known):
        pair = {"coulomb_friction", "spring"}
        return self.worth if pair <= known.names else -1.0 * len(known.names)


def test_what_leaves_a_gap_is_searched_beyond_single_steps():
    joint = ToyJoint(truth={"coulomb_friction": 1.0, "spring": 1.0})
    search = AskedTogether(joint, prior_odds(joint, {}, 0))
    assert search.grown(search.base) is search.base
    assert forward_then_backward(search, search.base).names == {"coulomb_friction", "spring"}
    search.worth = -1.0
    assert forward_then_backward(search, search.base) is search.base, "it would be less probable"


def test_nothing_is_fitted_beyond_a_set_that_leaves_no_gap(monkeypatch):
    search = search_of(ToyJoint(truth={"spring": 1.0}))
    best = search.grown(search.base)
    monkeypatch.setattr(Search, "one_more", None)
    assert forward_then_backward(search, best) is best
