"""Which effects are named in joints of known truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify import uncertain_effects
from hqpipe.identify.correlation import correlation_time
from hqpipe.identify.effect_band import effect_band
from hqpipe.identify.found import JointFound
from hqpipe.identify.identify import identify
from hqpipe.identify.joint_answer import _beside_unknown
from hqpipe.identify.joint_moves import Step
from hqpipe.identify.joint_search import JointSearch
from hqpipe.identify.model import Effect, LayerJoints, Parameter
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.rounds import searched, with_one_for_two
from hqpipe.identify.search import Search
from hqpipe.identify.uncertain_effects import certainty, without_uncertain
from hqpipe.identify.worth_keeping import _likelier


def _layer(*models):
    return LayerJoints("joint_motion", "rmse", 0.1, "", tuple(models))


def _found(*models, workers=1) -> tuple[JointFound, ...]:
    return identify(_layer(*models), workers=workers).found


def _names(joint: JointFound) -> list[str]:
    return [cause.effect for cause in joint.causes]


@pytest.mark.parametrize("correlation", [0.0, 0.9, 0.99])
def test_a_clean_joint_has_no_cause(correlation):
    assert not any(_names(_found(ToyJoint(correlation=correlation, seed=seed))[0]) for seed in range(20))


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_planted_effects_are_named_with_their_numbers(correlation):
    truth = {"coulomb_friction": 0.3, "spring": 0.5}
    (joint,) = _found(ToyJoint(truth=truth, correlation=correlation))
    assert sorted(_names(joint)) == sorted(truth)
    for cause in joint.causes:
        (number,) = cause.numbers
        assert number.value == pytest.approx(truth[cause.effect], rel=0.1)
        assert number.ci95[0] < truth[cause.effect] < number.ci95[1]
        assert cause.probability > 0.99
    assert np.mean(joint.named.heldout**2) < 0.5 * np.mean(joint.base.heldout**2)


class TwoAtOnce(ToyJoint):
    """Friction of which the regressor holds a spring as well: without the candidate for a spring it fits nothing."""

    effects = tuple(effect for effect in ToyJoint.effects if effect.name in ("coulomb_friction", "spring"))

    def _part(self, files, truth, *others):
        samples, regressors = super()._part(files, {}, *others)
        regressors = regressors[[0, 1, 2, 4]]
        regressors[2] += 15.0 * regressors[3]
        numbers = [truth.get(effect.name, 0.0) for effect in self.effects]
        return replace(samples, output=samples.output + numbers @ regressors[2:]), regressors


def test_two_effects_are_named_of_which_neither_is_asked_for_alone():
    joint = TwoAtOnce(truth={"coulomb_friction": 0.3, "spring": -4.5})
    search = Search(joint, prior_odds(joint, {}, 0))
    assert search.grown(search.base) is search.base
    (found,) = _found(joint)
    assert sorted(_names(found)) == ["coulomb_friction", "spring"]
    assert _names(_found(TwoAtOnce())[0]) == []


def test_what_the_law_of_a_joint_cannot_tell_apart_stands_beside_its_cause():
    class Ambiguous(ToyJoint):
        def same_by_law(self, values):
            assert values[[e.name for e in self.effects].index("spring") + len(self.base)] == pytest.approx(
                0.5, rel=0.1
            )
            return {"spring": ("viscous_friction",)}

    truth = {"coulomb_friction": 0.3, "spring": 0.5}
    plain, ambiguous = (_found(kind(truth=truth))[0] for kind in (ToyJoint, Ambiguous))
    assert {c.effect: c.confused_with for c in plain.causes} == {"coulomb_friction": (), "spring": ()}
    assert {c.effect: c.confused_with for c in ambiguous.causes} == {
        "coulomb_friction": (),
        "spring": ("viscous_friction",),
    }


def test_what_no_effect_describes_gets_no_name():
    (joint,) = _found(ToyJoint(truth={"cubic": 0.5}))
    assert _names(joint) == []
    assert joint.full.effects == ("cubic",)
    assert joint.shapes["position"] > 0.5


@pytest.mark.parametrize(("friction", "names"), [(0.09, []), (0.3, ["coulomb_friction"])])
def test_a_model_worse_than_persistence_that_leaves_most_of_the_gap_names_nothing(friction, names):
    model = ToyJoint(truth={"coulomb_friction": friction})
    assert _names(_found(model)[0]) == ["coulomb_friction"]
    model.fit.held[:] = model.fit.output + 0.05
    assert _names(_found(model)[0]) == names


def test_a_cause_that_the_held_out_trials_contradict_is_withdrawn():
    model = ToyJoint(truth={"coulomb_friction": 0.3, "spring": 0.4})
    model.heldout.output[:] -= 0.6 * np.sign(model.heldout.velocity)
    (joint,) = _found(model)
    assert _names(joint) == ["spring"]
    assert joint.withdrawn == ("coulomb_friction",)


@pytest.mark.parametrize(("share", "names"), [(0.8, ["coulomb_friction", "spring"]), (0.55, ["spring"])])
def test_a_cause_must_take_off_the_held_out_error_what_it_does_to_the_prediction(share, names):
    """With 0.55 of its size in these trials a cause still closes a share of their error, but a tenth of what it does."""
    model = ToyJoint(truth={"coulomb_friction": 0.3, "spring": 0.4})
    model.heldout.output[:] -= (1.0 - share) * 0.3 * np.sign(model.heldout.velocity)
    (joint,) = _found(model)
    assert sorted(_names(joint)) == names
    assert joint.withdrawn == (() if len(names) == 2 else ("coulomb_friction",))


def test_one_wild_held_out_trial_withdraws_nothing_that_the_others_bear_out():
    truth = {"coulomb_friction": 0.3, "spring": 0.4}
    model = ToyJoint(truth=truth)
    rng = np.random.default_rng(3)
    model.heldout, model._heldout = model._part(("c", "d", "e"), truth, 0.1, 0.0, 0.0, 20.0, rng)
    wild = model.heldout.trial == 0
    model.heldout.output[wild] -= 0.55 * np.sign(model.heldout.velocity[wild])
    (joint,) = _found(model)
    assert sorted(_names(joint)) == sorted(truth)
    without = joint.without["coulomb_friction"].heldout
    assert np.sum(without**2) < np.sum(joint.named.heldout**2), "all trials together speak against it"


def test_two_large_causes_that_can_take_each_others_part_are_both_named():
    model = ToyJoint(truth={"spring": 4.0}, noise=0.002)
    model.effects = tuple(replace(e, named=e.name != "quadratic") for e in model.effects)
    for part, regressors in ((model.fit, model._fit), (model.heldout, model._heldout)):
        regressors[5] = np.sin(part.position)  # in the place of the cubic one, and nearly a spring
        part.output[:] += 4.0 * regressors[5]
    (joint,) = _found(model)
    assert {"spring", "cubic"} <= set(_names(joint))
    gap = np.mean(joint.base.error**2)
    closes = np.mean(joint.without["spring"].error ** 2) - np.mean(joint.named.error**2)
    assert closes < 0.01 * gap, "by itself it closes next to nothing"


@pytest.mark.parametrize("stiffness, cause", [(0.2, False), (0.4, True)])
def test_what_every_sound_machine_has_of_an_effect_stands_beside_the_base(stiffness, cause):
    model = ToyJoint(truth={"spring": stiffness, "coulomb_friction": 0.3}, seed=3)
    ordinary = (Parameter("nm_per_rad", "N·m/rad", 0.0, 0.5, least=0.3),)
    model.effects = tuple(replace(e, parameters=ordinary) if e.name == "spring" else e for e in model.effects)
    (joint,) = _found(model)
    assert set(_names(joint)) == ({"spring", "coulomb_friction"} if cause else {"coulomb_friction"})
    assert joint.base.effects == (() if cause else ("spring",))


@pytest.mark.parametrize("most, cause", [(0.1, True), (0.3, False)])
def test_what_a_sound_machine_has_of_an_effect_may_depend_on_the_other_numbers(most, cause):
    class Toy(ToyJoint):
        def sound_sizes(self, values):
            return {"spring": most * values[0]}  # of the inertia, which is 1

    (joint,) = _found(Toy(truth={"spring": 0.2, "coulomb_friction": 0.3}, seed=3))
    assert ("spring" in _names(joint)) is cause and "spring" in joint.kept.effects
    assert joint.base.effects == (() if cause else ("spring",))


def test_what_every_sound_machine_has_beside_a_cause_belongs_to_the_law_though_it_would_grow_without_it():
    """A spring of ordinary size and friction that goes with the position, too: alone, the spring takes the part of both."""
    model = ToyJoint(truth={"spring": 0.7}, noise=0.05, seed=3)
    ordinary = (Parameter("nm_per_rad", "N·m/rad", 0.0, 0.5, least=1.0),)
    model.effects = tuple(replace(e, parameters=ordinary) if e.name == "spring" else e for e in model.effects)
    for part, regressors in ((model.fit, model._fit), (model.heldout, model._heldout)):
        regressors[2] = part.position * np.abs(part.position)
        part.output[:] += 1.5 * regressors[2]
    (joint,) = _found(model)
    assert _names(joint) == ["coulomb_friction"]
    assert joint.base.effects == () and set(joint.kept.effects) == {"coulomb_friction", "spring"}
    assert np.mean(joint.named.error**2) < 1.05 * model.noise[0] ** 2


def test_what_the_prediction_settles_by_itself_has_its_price():
    model = ToyJoint(truth={"spring": 0.5}, seed=3)
    search = Search(model, prior_odds(model, {}, 0))
    spring = search.grown_by(search.base, "spring")
    free = search.gain(spring, search.base)
    search.effects["spring"] = replace(search.effects["spring"], settled=2)
    independent = 0.5 * len(model.fit.trial) / correlation_time(spring.solution.error, model.fit)
    assert free - search.gain(spring, search.base) == pytest.approx(np.log(independent))


@pytest.mark.parametrize("stiffness, names", [(0.02, []), (0.2, ["spring"])])
def test_what_takes_little_off_the_error_joins_no_set_however_significant(stiffness, names):
    joint = ToyJoint(truth={"spring": stiffness}, seed=3)
    search = Search(joint, prior_odds(joint, {}, 0))
    reached = searched(search, alone=False)
    assert search.gain(search.grown_by(search.base, "spring"), search.base) > 10.0
    assert sorted(reached.names) == names


@pytest.mark.parametrize("stiffness, names", [(0.01, []), (0.3, ["spring"])])
def test_what_a_simulator_would_not_notice_is_no_cause_however_precise_the_sensors(stiffness, names):
    joint = ToyJoint(truth={"spring": stiffness}, noise=0.001, seed=3)
    assert _names(_found(joint)[0]) == names


def test_of_names_that_nothing_tells_apart_one_is_given_and_the_others_are_told():
    model = ToyJoint(truth={"spring": 1.0}, seed=3)
    spring, whole = len(model.base) + 2, model.error
    model.effects += tuple(Effect(name, (Parameter("nm_per_rad", "N·m/rad", 0.0, 0.5),)) for name in ("belt", "cable"))

    def error(values, heldout=False):
        alike = values[:-2].copy()
        alike[spring] += values[-2:].sum()
        return whole(alike, heldout)

    model.error = error
    (joint,) = _found(model)
    (cause,) = joint.causes
    assert {cause.effect, *cause.confused_with} == {"spring", "belt", "cable"}
    assert cause.probability == pytest.approx(1.0 / 3.0, abs=0.05)


def test_an_effect_whose_number_cannot_be_told_from_none_gives_way_to_what_it_stood_for():
    """A hook that holds an offset of each trial, whatever its own number: what it does has nothing to do with that."""
    model = ToyJoint(truth={"spring": 1.0}, seed=3)
    whole = model.error
    model.effects += (Effect("hook", (Parameter("size", "1", 0.0, 0.5, 0.0, 2.0),)),)

    def error(values, heldout=False):
        found = whole(values[:-1], heldout)
        q = (model.heldout if heldout else model.fit).position
        holds = values[-1] > 0.0 and values[len(model.base) + 2] == 0.0
        return found + q * holds + 1e-3 * values[-1]

    model.error = error
    search = Search(model, prior_odds(model, {}, 0))
    hook = search.grown_by(search.base, "hook")
    assert search.gain(hook, search.base) > 10.0 and certainty(search, hook, "hook") < 1.0
    better = without_uncertain(search, hook)
    assert better.names == {"spring"} and certainty(search, better, "spring") > 1.0
    model.effects = tuple(e for e in model.effects if e.named)  # nothing else takes its part
    model.error = lambda values, heldout=False: error(
        np.concatenate([values[: len(model.base) + 3], np.zeros(2), values[-1:]]), heldout
    )
    assert _names(_found(model)[0]) == ["spring"]


def test_of_two_effects_that_make_each_other_uncertain_one_stays(monkeypatch):
    monkeypatch.setattr(uncertain_effects, "certainty", lambda search, known, name: 2.0 / len(known.names) ** 2)
    model = ToyJoint(truth={"spring": 1.0, "viscous_friction": 1.0}, seed=3)
    search = Search(model, prior_odds(model, {}, 0))
    both = search.grown_by(search.grown_by(search.base, "spring"), "viscous_friction")
    assert len(without_uncertain(search, both).names) == 1 and not search.refused, "the other could take its place"


def test_numbers_of_unlike_size_are_weighed_alike():
    """A limit in 1/N beside a share: their variances differ by more than a matrix of both resolves."""
    model = ToyJoint(truth={"spring": 1.0}, seed=3)
    shares = Parameter("share", "1", 0.0, 0.5), Parameter("inverse_limit", "1/N", 0.0, 0.5e-9)
    spring, whole = len(model.base) + 2, model.error
    model.effects += (Effect("limited", shares),)

    def error(values, heldout=False):
        part = model.heldout if heldout else model.fit
        alike = values[:-2].copy()
        alike[spring] += values[-1] * 1e9
        return whole(alike, heldout) + values[-2] * np.sin(20.0 * part.position)

    model.error = error
    search = Search(model, prior_odds(model, {}, 0))
    assert certainty(search, search.grown_by(search.base, "limited"), "limited") > 10.0


def test_a_number_that_only_shapes_an_effect_makes_it_no_less_like_another():
    friction = ToyJoint.effects[0]
    shaped = replace(friction, parameters=(*friction.parameters, Parameter("speed", "rad/s", 0.1, 0.1, shape=True)))
    assert friction.sizes == shaped.sizes == 1


def _under_two_names():
    """A joint with a spring that may be told as a belt as well."""
    model = ToyJoint(truth={"spring": 1.0}, seed=3)
    spring, whole = len(model.base) + 2, model.error
    model.effects += (Effect("belt", (Parameter("nm_per_rad", "N·m/rad", 0.0, 0.5),)),)

    def error(values, heldout=False):
        alike = values[:-1].copy()
        alike[spring] += values[-1]
        return whole(alike, heldout)

    model.error = error
    return model


def test_a_joint_that_takes_the_name_of_the_others_still_tells_its_own():
    joint = JointSearch(_under_two_names(), prior_odds)
    (before,) = joint.first(alone=False)
    (other,) = {"spring", "belt"} - {before}
    (cause,) = joint.renamed(Step(before, other)).causes
    assert cause.effect == other and cause.confused_with == (before,)
    assert cause.probability == pytest.approx(0.5, abs=0.05)


def _driven_by_two_together():
    """A joint with a spring that is there only if two effects are, so that neither joins without the other."""
    model = ToyJoint(truth={"spring": 0.5}, seed=4)
    whole, spring = model.error, len(model.base) + 2
    model.effects = tuple(effect for effect in model.effects if effect.name != "spring")
    model.effects += (
        Effect("belt", (Parameter("stiffness", "N·m/rad", 0.0, 0.5),)),
        Effect("clutch", (Parameter("closed", "1", 0.0, 1.0),)),
    )

    def error(values, heldout=False):
        return whole(np.insert(values[:-2], spring, values[-2] * values[-1]), heldout)

    model.error = error
    return model


def test_a_joint_takes_over_what_another_has_reached_where_its_own_steps_do_not_lead():
    both = frozenset({"belt", "clutch"})
    joint = JointSearch(_driven_by_two_together(), prior_odds)
    assert not joint.first(alone=False) & both
    names, _ = joint.weighed_again([both] * 2, [{"belt": np.array([1.0]), "clutch": np.array([0.3])}] * 2)
    assert both <= names
    assert np.prod([number[0] for number in joint.reached().values()]) == pytest.approx(0.5, rel=0.05)


def test_a_joint_that_lacks_what_another_has_reached_goes_on_without_it():
    joint = JointSearch(_driven_by_two_together(), prior_odds)
    joint.first(alone=False)
    foreign, longer = {"backlash": np.array([0.01])}, {"belt": np.array([1.0, 2.0]), "clutch": np.array([0.5])}
    names, _ = joint.weighed_again([frozenset(foreign), frozenset(longer)], [foreign, longer])
    assert "backlash" not in names


def test_a_likelier_set_that_was_passed_over_for_a_larger_one_is_taken_when_that_shrinks():
    model = ToyJoint(truth={"coulomb_friction": 0.3})
    search = Search(model, prior_odds(model, {}, 0))
    true, other = search.grown_along(["coulomb_friction"]), search.grown_along(["viscous_friction", "cubic"])
    assert _likelier(search, other, search.base) is true
    assert _likelier(search, true, search.base) is true


def test_joints_that_agree_on_a_name_do_not_make_it_surer_than_one_that_is_as_good():
    joint = JointSearch(_under_two_names(), prior_odds)
    joint.told([joint.first(alone=False)] * 11)
    (cause,) = joint.answered().causes
    assert len(cause.confused_with) == 1 and cause.probability == pytest.approx(0.5, abs=0.05)


def test_a_cause_that_is_small_beside_what_is_left_unexplained_needs_other_joints():
    doubtful = ToyJoint("hip", truth={"coulomb_friction": 0.15}, unknown=0.4)
    (alone,) = _found(doubtful)
    assert _names(alone) == [] and alone.minor == ("coulomb_friction",)
    others = [ToyJoint(name, truth={"coulomb_friction": 0.6}, seed=k + 1) for k, name in enumerate(("knee", "ankle"))]
    assert [_names(joint) for joint in _found(doubtful, *others)] == [["coulomb_friction"]] * 3


def test_what_a_shape_describes_is_unknown_where_a_cause_is_held_against_it():
    truth = {"coulomb_friction": 0.1, "cubic": 0.5}
    (joint,) = _found(ToyJoint("hip", truth=truth))
    assert "cubic" in joint.kept.effects and joint.unexplained < 0.3
    assert _names(joint) == [] and joint.minor == ("coulomb_friction",)
    (clear,) = _found(ToyJoint("hip", truth=truth | {"coulomb_friction": 0.3}))
    assert _names(clear) == ["coulomb_friction"]


class Curved(ToyJoint):
    """Friction and a little more, and a shape that describes friction and too much of the rest."""

    more = 0.006

    def _part(self, files, truth, *others):
        samples, regressors = super()._part(files, truth, *others)
        rest = self.more * regressors[3] * np.abs(regressors[3])
        regressors = regressors.copy()
        regressors[6] = regressors[2] + 2.0 * rest / 0.6
        return replace(samples, output=samples.output + rest), regressors


@pytest.mark.parametrize("more,told_alone", [(0.006, True), (0.06, False)])
def test_a_curve_that_describes_friction_does_not_hide_it_where_friction_alone_leaves_little(more, told_alone):
    joint = type("Curve", (Curved,), {"more": more})("hip", truth={"coulomb_friction": 0.6}, noise=0.01)
    search = Search(joint, prior_odds(joint, {}, 0))
    claimed = search.begun_at({"coulomb_friction": np.full(1, 0.6), "quadratic": np.full(1, 0.1)})
    unshaped = search.without(claimed, "quadratic")
    found = _beside_unknown(search, claimed, unshaped, search.base, ["coulomb_friction"])["coulomb_friction"]
    beside, alone = (
        search.left_out(search.without(known, "coulomb_friction")) - search.left_out(known)
        for known in (claimed, unshaped)
    )
    assert (found.unknown < 0.05) is told_alone and beside < 0.5 * alone
    expected = alone if told_alone else beside
    assert found.closes == pytest.approx(expected / search.left_out(search.base), rel=0.2)


class Fast(ToyJoint):
    """The spring of this joint pulls fast."""

    def _part(self, files, truth, *others):
        samples, regressors = super()._part(files, truth, *others)
        fast = np.sin(60.0 * samples.time)
        more = truth.get("spring", 0.0) * (fast - regressors[4])
        regressors = regressors.copy()
        regressors[4] = fast
        return replace(samples, output=samples.output + more), regressors


def test_a_cause_that_is_faster_than_most_of_what_its_set_does_counts_all_the_same():
    joint = Fast("hip", truth={"coulomb_friction": 1.0, "spring": 0.1}, noise=0.01)
    search = Search(joint, prior_odds(joint, {}, 0))
    both = search.begun_at({"coulomb_friction": np.ones(1), "spring": np.full(1, 0.1)})
    band = effect_band(search.base.solution.error - both.solution.error, joint.fit)
    assert band.highest < 60.0 / (2.0 * np.pi) * joint.dt
    found = _beside_unknown(search, both, both, search.base, ["coulomb_friction", "spring"])
    assert found["spring"].closes == pytest.approx(
        0.5 * 0.1**2 * len(joint.fit.time) / search.left_out(search.base), rel=0.2
    )
    assert found["spring"].unknown < 0.1 * found["spring"].closes


def test_intervals_hold_the_truth_nineteen_times_in_twenty():
    inside = []
    for seed in range(40):
        (joint,) = _found(ToyJoint(truth={"coulomb_friction": 0.2}, correlation=0.95, seed=seed))
        low, high = joint.causes[0].numbers[0].ci95
        inside.append(low <= 0.2 <= high)
    assert 0.85 <= np.mean(inside) <= 1.0


def test_joints_that_have_an_effect_support_it_in_one_that_hardly_shows_it():
    sure = [ToyJoint(str(j), {"viscous_friction": 0.2}, correlation=0.95, seed=j) for j in range(1, 5)]
    for seed in range(3):
        doubtful = ToyJoint("0", {"viscous_friction": 0.05}, correlation=0.95, seed=10 + seed)
        alone, together = _found(doubtful)[0], _found(doubtful, *sure)[0]
        assert together.probabilities["viscous_friction"] > alone.probabilities["viscous_friction"]


def test_workers_do_not_change_the_answer():
    joints = [ToyJoint(str(j), {"spring": 0.3 * (j % 2)}, seed=j) for j in range(4)]
    one, two = _found(*joints), _found(*joints, workers=2)
    assert [joint.causes for joint in one] == [joint.causes for joint in two]


def test_a_number_that_differs_between_trials_is_told():
    model = ToyJoint(truth={"coulomb_friction": 0.3})
    model.fit.output[model.fit.trial == 1] += 0.3 * np.sign(model.fit.velocity[model.fit.trial == 1])
    other = ToyJoint(truth={"coulomb_friction": 0.3}, seed=1)
    merged = _with_third_trial(model, other)
    (joint,) = _found(merged)
    assert any("friction_nm differs from trial to trial" in text for text in joint.drifts)
    assert not _found(ToyJoint(truth={"coulomb_friction": 0.3}))[0].drifts


@pytest.mark.parametrize("difference, is_told", [(0.17, False), (0.5, True)])
def test_a_difference_between_trials_is_told_where_it_matters(difference, is_told):
    """Both are more than chance; 0.17 N·m in one trial of three are 0.46 % of the torque's spread."""
    model = ToyJoint(truth={"coulomb_friction": 0.3})
    model.fit.output[model.fit.trial == 1] += difference * np.sign(model.fit.velocity[model.fit.trial == 1])
    (joint,) = _found(_with_third_trial(model, ToyJoint(truth={"coulomb_friction": 0.3}, seed=1)))
    assert any("friction_nm differs from trial to trial" in text for text in joint.drifts) == is_told


def _with_third_trial(model, other):
    from hqpipe.identify.change import _joined

    model.fit, model._fit = _joined(model.fit, other.fit), np.concatenate([model._fit, other._fit], axis=1)
    return model


def test_the_order_of_a_set_does_not_decide_which_effect_is_tried_first():
    class Tried:
        """A search that notes what it is asked for and finds that nothing helps."""

        model = ToyJoint(seconds=1.0)
        base = SimpleNamespace(names=frozenset(), solution=SimpleNamespace(square=0.0))

        def __init__(self):
            self.effects, self.asked, self.known = {effect.name: effect for effect in self.model.effects}, [], {}

        def addable(self, names):
            return [*self.effects]

        def grown_by(self, known, name):
            self.asked.append(name)
            return known

        def grown_along(self, names):
            return SimpleNamespace(names=frozenset(names))

        def gain(self, large, small):
            return -1.0

        def preference(self, one, other):
            return -1.0

        def improved(self, known):
            return known

    asked = []
    for names in (("spring", "viscous_friction"), ("viscous_friction", "spring")):
        joint = JointSearch(Tried.model, prior_odds)
        joint._search = Tried()
        joint._known = joint._search.base
        joint.weighed_again([names] * 9, [])
        asked.append(joint._search.asked)
    assert asked[0] == asked[1] == ["spring", "viscous_friction"]


def test_a_joint_without_any_torque_has_no_cause():
    model = ToyJoint(noise=0.0, seconds=4.0)
    model.fit.output[:] = model.fit.held[:] = 0.0
    (joint,) = _found(model)
    assert _names(joint) == [] and np.isfinite(list(joint.gains.values())).all()


@pytest.mark.parametrize("least_friction", [0.01, np.inf])
def test_a_prediction_that_overflows_is_no_error_of_the_search(least_friction):
    class Unstable(ToyJoint):
        """Runs away unless friction damps it."""

        def error(self, values, heldout=False):
            found = super().error(values, heldout)
            return found if values[2] >= least_friction else np.full(len(found), 1e200)

    (joint,) = _found(Unstable(truth={"coulomb_friction": 0.3}, seconds=4.0))
    assert np.isfinite(list(joint.probabilities.values())).all()


def test_what_few_joints_have_must_show_more_than_what_most_have():
    """Friction that closes less than half of what is wrong in each joint, beside a law that no candidate describes."""

    def named(*friction):
        models = [
            ToyJoint(str(j), {"coulomb_friction": size}, noise=0.005, seed=3 + j, unknown=0.2)
            for j, size in enumerate(friction)
        ]
        for model in models:
            model.effects = tuple(replace(e, common=False) for e in model.effects if e.named)
            whole = model.error
            model.error = lambda values, heldout=False, whole=whole: whole(np.append(values, [0.0, 0.0]), heldout)
        return ["coulomb_friction" in _names(joint) for joint in _found(*models)]

    assert named(0.12, 0.0, 0.0, 0.0) == [False] * 4
    assert named(0.4, 0.0, 0.0, 0.0) == [True, False, False, False]
    assert named(0.12, 0.12, 0.12, 0.12) == [True] * 4


def test_what_most_joints_have_needs_less_to_stand_in_the_place_of_what_few_have():
    """In one joint a spring that bends describes more of what no law says; by itself it would be certain there."""

    def joint(j, bent):
        model = ToyJoint(str(j), {"spring": 1.0}, noise=0.3, seed=3 + j)
        whole, spring = model.error, len(model.base) + 2

        def bend(heldout):
            return 0.03 * np.sin(13.0 * (model.heldout if heldout else model.fit).position)

        model.effects = (
            *(e for e in model.effects if e.named),
            Effect("belt", (Parameter("stiffness", "N·m/rad", 0.0, 0.5),)),
        )

        def error(values, heldout=False):
            stiffness, belt = values[spring], values[-1]
            straight = whole(np.array([*values[:spring], stiffness + belt, 0.0, 0.0]), heldout)
            return straight + (belt - bent) * bend(heldout)

        model.error = error
        return model

    alone = _found(joint(4, 1.0))[0].causes[0]
    assert (alone.effect, alone.confused_with) == ("belt", ())
    machine = [found.causes[0] for found in _found(*(joint(j, float(j == 4)) for j in range(5)))]
    assert [cause.effect for cause in machine] == ["spring"] * 5
    assert machine[4].confused_with == ("belt",)


def test_two_effects_of_few_joints_give_way_to_one_that_does_nearly_the_same():
    """A spring that no law says exactly is described a little better by one for each side."""
    model = ToyJoint(noise=0.2, seed=3)
    whole, spring = model.error, len(model.base) + 2
    sides = tuple(Effect(name, (Parameter("stiffness", "N·m/rad", 0.0, 0.5),)) for name in ("upper", "lower"))
    model.effects = (*(e for e in model.effects if e.named), *sides)

    def error(values, heldout=False):
        q = (model.heldout if heldout else model.fit).position
        upper, lower = np.where(q > 0.0, 1.05 * q, 0.0), np.where(q > 0.0, 0.0, 0.95 * q)
        found = whole(np.array([*values[:spring], values[spring], 0.0, 0.0]), heldout)
        return found + (values[-2] - 1.0) * upper + (values[-1] - 1.0) * lower

    model.error = error
    search = Search(model, prior_odds(model, {}, 0))
    both = search.grown_along(["upper", "lower"])
    one = search.grown_by(search.base, "spring")
    assert both.names == {"upper", "lower"} and 5.0 < search.preference(both, one) < 50.0
    assert with_one_for_two(search, both) is both
    search.rare = frozenset(both.names)
    assert with_one_for_two(search, both).names == {"spring"}
