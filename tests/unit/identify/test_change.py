"""What changed between two records of a joint, or since what a model says of it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.errors import UsageError
from hqpipe.identify.change import Both, Changed, KnownJoint
from hqpipe.identify.found import JointFound
from hqpipe.identify.identify import identify
from hqpipe.identify.model import LayerJoints, Ratio

Z95 = 1.959964


def _layer(*models):
    return LayerJoints("joint_motion", "rmse", 0.1, "", tuple(models))


def _found(*models, reference) -> tuple[JointFound, ...]:
    return identify(_layer(*models), reference=_layer(*reference)).found


def _names(joint: JointFound) -> list[str]:
    return [cause.effect for cause in joint.causes]


def test_nothing_changed():
    truth = {"coulomb_friction": 0.3}
    (joint,) = _found(ToyJoint(truth=truth, seed=1), reference=[ToyJoint(truth=truth, seed=2)])
    assert _names(joint) == []


def test_grown_friction_is_named_beside_what_it_was():
    (joint,) = _found(
        ToyJoint(truth={"coulomb_friction": 0.5, "spring": 0.4}, seed=1),
        reference=[ToyJoint(truth={"coulomb_friction": 0.3, "spring": 0.4}, seed=2)],
    )
    assert _names(joint) == ["coulomb_friction"]
    (number,) = joint.causes[0].numbers
    assert number.reference == pytest.approx(0.3, abs=0.02)
    assert number.value == pytest.approx(0.5, abs=0.02)
    assert number.ci95[0] < 0.5 < number.ci95[1]
    assert np.mean(joint.named.heldout**2) < 0.5 * np.mean(joint.base.heldout**2)
    assert "spring in both records" in joint.named.effects
    assert np.sqrt(np.mean(joint.named.heldout**2)) < 1.2 * joint.model.noise[1]


@pytest.mark.parametrize("left", [0.0, 0.03])
def test_an_effect_that_has_gone_is_named_beside_what_it_was(left):
    then = {"coulomb_friction": 0.3, "spring": 0.4}
    (joint,) = _found(
        ToyJoint(truth=then | {"coulomb_friction": left}, seed=1), reference=[ToyJoint(truth=then, seed=2)]
    )
    assert _names(joint) == ["coulomb_friction"]
    (number,) = joint.causes[0].numbers
    assert number.reference == pytest.approx(0.3, abs=0.02) and number.value == pytest.approx(left, abs=0.02)
    assert 0.0 <= number.ci95[0] <= number.value <= number.ci95[1]


@pytest.mark.parametrize("left", [0.0, 0.03])
def test_an_effect_of_a_model_that_has_gone_is_named(left):
    joint = since(ToyJoint(truth={"coulomb_friction": left}, seed=1), known(coulomb_friction=0.3))
    assert _names(joint) == ["coulomb_friction"]
    (number,) = joint.causes[0].numbers
    assert number.reference == 0.3 and number.value == pytest.approx(left, abs=0.02)
    assert 0.0 <= number.ci95[0] <= number.value <= number.ci95[1]


def test_a_new_effect_has_a_neutral_reference():
    (joint,) = _found(ToyJoint(truth={"spring": 0.4}, seed=1), reference=[ToyJoint(seed=2)])
    assert _names(joint) == ["spring"]
    assert joint.causes[0].numbers[0].reference == pytest.approx(0.0, abs=0.02)


def test_a_base_number_that_changed_is_no_name():
    (joint,) = _found(ToyJoint(truth={"offset": 0.4}, seed=1), reference=[ToyJoint(seed=2)])
    assert _names(joint) == []
    assert joint.shapes["offset"] > 0.5


def test_a_base_number_with_a_name_is_named():
    now = ToyJoint(truth={"inertia": 1.3}, seed=1)
    now.changes = {"payload": ("inertia",)}
    (joint,) = _found(now, reference=[ToyJoint(seed=2)])
    assert _names(joint) == ["payload"]
    assert joint.causes[0].numbers[0].value == pytest.approx(1.3, abs=0.02)


def test_an_effect_that_the_reference_cannot_show_is_left_out_there():
    truth = {"coulomb_friction": 0.3, "spring": 0.4}
    then = ToyJoint(truth={**truth, "coulomb_friction": 0.0}, seed=2)
    whole, then.effects = then.error, then.effects[1:]
    then.error = lambda values, heldout=False: whole(np.insert(values, len(then.base), 0.0), heldout)
    (joint,) = _found(ToyJoint(truth=truth, seed=1), reference=[then])
    assert joint.model.both.then is then
    assert not {"spring", "viscous_friction", "payload"} & set(_names(joint))
    assert np.sqrt(np.mean(joint.full.heldout**2)) < 0.11


def test_progress_grows_once_over_both_searches():
    seen = []
    joints = [[ToyJoint(str(j), seed=seed + j, seconds=4.0) for j in range(2)] for seed in (1, 5)]
    now, then = (_layer(*models) for models in joints)
    identify(now, reference=then, progress=lambda done, total, text: seen.append((done, total)))
    assert seen == [(0.5, 2), (1.0, 2), (1.5, 2), (2.0, 2)]


def test_a_joint_without_a_reference_is_refused():
    with pytest.raises(UsageError, match="the reference has no joint 'knee'"):
        _found(ToyJoint("knee"), reference=[ToyJoint("hip")])


def known(unknown=(), sd=None, **truth):
    """What a model says of a toy joint; sd: name → standard deviation."""
    names = ["inertia", "offset", *(effect.name for effect in ToyJoint.effects)]
    values = np.array([truth.get(name, 1.0 if name == "inertia" else 0.0) for name in names])
    sure = np.array([name not in unknown for name in names])
    return KnownJoint(values, sure, np.array([(sd or {}).get(name, 0.0) for name in names]))


def since(model, then) -> JointFound:
    (joint,) = identify(_layer(model), reference={"hip": then}).found
    return joint


def multiplied(at, values, ratio):
    values[at] *= ratio


def with_ratios(**kwargs):
    """A toy joint of which the inertia alone, or inertia and offset together, may change by a ratio."""
    joint = ToyJoint(**kwargs)
    joint.ratios = {
        "payload": Ratio(("inertia",), partial(multiplied, [0])),
        "scale": Ratio(("inertia", "offset"), partial(multiplied, [0, 1])),
    }
    return joint


def test_nothing_changed_since_a_model_that_says_all():
    truth = {"coulomb_friction": 0.3, "offset": 0.4}
    joint = since(ToyJoint(truth=truth, seed=1), known(**truth))
    assert _names(joint) == [] and joint.base.values[:0].shape == (0,)
    np.testing.assert_array_equal(joint.base.error, ToyJoint(truth=truth, seed=1).error(known(**truth).values))


def test_what_a_model_does_not_know_is_fitted_and_no_change():
    joint = since(ToyJoint(truth={"offset": 0.7}, seed=1), known(unknown=("offset",)))
    assert _names(joint) == [] and not joint.shapes
    assert joint.model.then_values(joint.base.values)[1] == pytest.approx(0.7, abs=0.02)


def test_what_a_model_knows_stands_where_it_put_it():
    joint = since(
        ToyJoint(truth={"coulomb_friction": 0.5, "offset": 0.7}, seed=1), known(offset=0.7, coulomb_friction=0.3)
    )
    assert _names(joint) == ["coulomb_friction"]
    (number,) = joint.causes[0].numbers
    assert number.reference == 0.3 and number.value == pytest.approx(0.5, abs=0.02)
    np.testing.assert_array_equal(
        joint.model.then_values(joint.kept.values), known(offset=0.7, coulomb_friction=0.3).values
    )


def test_an_effect_that_a_model_lacks_is_new():
    joint = since(ToyJoint(truth={"spring": 0.4}, seed=1), known())
    assert _names(joint) == ["spring"] and joint.causes[0].numbers[0].reference == 0.0


def test_a_model_without_a_joint_is_refused_with_the_nearest_name():
    with pytest.raises(UsageError, match=r"has no joint 'hip'.*did you mean 'hips'"):
        identify(_layer(ToyJoint()), reference={"hips": known()})


def test_a_base_changes_by_a_ratio_that_says_itself_what_it_refers_to():
    joint = since(with_ratios(truth={"inertia": 1.3, "offset": 0.4}, seed=1), known(offset=0.4))
    assert _names(joint) == ["payload"]
    (number,) = joint.causes[0].numbers
    assert (number.name, number.unit, number.reference) == ("ratio", "1", None)
    assert number.value == pytest.approx(1.3, abs=0.02) and number.ci95[0] < 1.3 < number.ci95[1]
    assert joint.model.before("payload", joint.kept.values) == [1.0]
    now = joint.model.now_values(joint.kept.values)
    assert now[0] == pytest.approx(number.value) and now[1] == 0.4
    np.testing.assert_array_equal(joint.model.now_values(joint.kept.values, ("payload",)), known(offset=0.4).values)


def test_numbers_that_change_together_are_one_ratio():
    joint = since(with_ratios(truth={"inertia": 1.3, "offset": 0.52}, seed=1), known(offset=0.4))
    assert _names(joint) == ["scale"] and joint.causes[0].numbers[0].value == pytest.approx(1.3, abs=0.02)


@pytest.mark.parametrize("grown,alike", [(0.8, ("spring",)), (1.25, ())])
def test_what_looks_like_a_smaller_ratio_is_told_beside_it_and_not_beside_a_larger_one(grown, alike):
    model = with_ratios(truth={"inertia": grown, "offset": 0.4}, seed=1)
    model.ratios["payload"] = Ratio(("inertia",), partial(multiplied, [0]), alike_below=("spring",))
    (cause,) = since(model, known(offset=0.4)).causes
    assert cause.effect == "payload" and cause.confused_with == alike


def test_where_all_of_a_base_goes_by_ratios_no_number_deviates_by_itself():
    names = {effect.name for effect in since(with_ratios(seed=1), known()).model.effects}
    assert {"payload", "scale"} < names and not any(name.startswith("change of") for name in names)
    assert {"change of inertia", "change of offset"} < {e.name for e in since(ToyJoint(seed=1), known()).model.effects}


def test_ratios_compose():
    changed = Changed(Both(ToyJoint(seed=2), with_ratios(seed=1)), np.arange(0), known(offset=0.4).values)
    values = np.array([parameter.neutral for effect in changed.effects for parameter in effect.parameters])
    np.testing.assert_array_equal(changed.now_values(values), known(offset=0.4).values)
    values[:2] = 1.5, 0.5
    assert changed.now_values(values)[:2] == pytest.approx([0.75, 0.2])


@pytest.mark.parametrize(
    ("truth", "then", "name", "scale"),
    [
        (
            {"inertia": 1.3, "offset": 0.4},
            {"offset": 0.4},
            "inertia",
            1.3,
        ),  # a ratio: what is unsure of 1 is 1.3 times as much of it
        ({"coulomb_friction": 0.5}, {"coulomb_friction": 0.3}, "coulomb_friction", 1.0),
    ],
)
def test_what_is_unsure_about_a_model_widens_an_interval(truth, then, name, scale):
    sure, unsure = (since(with_ratios(truth=truth, seed=1), known(sd=sd, **then)) for sd in ({}, {name: 0.05}))
    (one,), (two,) = (joint.causes[0].numbers for joint in (sure, unsure))
    assert two.value == one.value and two.reference == one.reference
    for end in (0, 1):
        own = abs(one.ci95[end] - one.value)
        assert abs(two.ci95[end] - two.value) == pytest.approx(np.hypot(own, Z95 * 0.05 * scale), rel=1e-3)


def test_an_interval_of_a_ratio_holds_no_negative_one():
    joint = since(with_ratios(truth={"inertia": 1.3, "offset": 0.4}, seed=1), known(offset=0.4, sd={"inertia": 2.0}))
    low, high = joint.causes[0].numbers[0].ci95
    assert low == 0.0 and high > 5.0


class Counted(ToyJoint):
    """Counts its predictions, of which the next one overwrites the last."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.asked, self.out = 0, np.zeros(len(self.fit.time))

    def error(self, values, heldout=False):
        self.asked += 1
        if heldout:
            return super().error(values, True)
        self.out[:] = super().error(values)
        return self.out


def test_the_error_of_the_earlier_record_is_only_computed_for_other_numbers():
    then, now = Counted(seed=2, seconds=4.0), ToyJoint(seed=1, seconds=4.0)
    both, plain = Both(then, now), ToyJoint(seed=2, seconds=4.0)
    first, second = known().values, known(spring=0.3, offset=0.1).values
    for before, after, asked in [
        (first, first, 1),
        (first, second, 1),
        (second, first, 2),
        (second, second, 2),
        (first, first, 3),
    ]:
        error = both.error_of(before, after, False)
        np.testing.assert_array_equal(error, np.concatenate([plain.error(before), now.error(after)]))
        assert then.asked == asked
        then.out[:] = np.nan
    before = first.copy()
    both.error_of(before, first, False)
    before[1] = 0.5  # the numbers asked with are the caller's own
    np.testing.assert_array_equal(both.error_of(before, first, False)[: len(then.fit.time)], plain.error(before))


def test_held_out_is_the_later_record_alone():
    then, now = Counted(seed=2, seconds=4.0), ToyJoint(seed=1, seconds=4.0)
    both = Both(then, now)
    np.testing.assert_array_equal(both.error(known().values, True), now.error(known().values, True))
    assert then.asked == 0 and both.heldout is now.heldout


def test_a_model_alone_is_asked_for_no_prediction_and_refers_to_nothing():
    class Referring(ToyJoint):
        def referred_to(self, values, other):
            return values * other.of_its_own  # which a model alone has not

    joint = since(Referring(truth={"spring": 0.4}, seed=1), known())
    assert _names(joint) == ["spring"] and len(joint.base.error) == len(joint.model.both.now.fit.time)
