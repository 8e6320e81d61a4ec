"""Causes of a layer: joints that agree share one, no number is lost, shares add up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layer_cases import cause, layer_found, layer_joints, log_set, made_up, number, toy

from hqpipe.gap.answer.layer_causes import merge_causes, reporting, shares, unsigned_joints
from hqpipe.gap.residuals.layer_errors import layer_errors


@pytest.fixture(scope="module")
def models():
    return [toy(name, seed, seconds=6.0) for seed, name in enumerate(("hip", "knee", "foot"))]


def errors_of(*joints):
    found = layer_found(*joints)
    return found, layer_errors(found, log_set([joint.model for joint in joints]))


def test_joints_that_agree_share_a_cause_and_keep_their_numbers(models):
    sizes = (0.50, 0.54, 2.0)
    found, errors = errors_of(
        *(
            made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", number("friction_nm", s, 0.05))])
            for m, s in zip(models, sizes, strict=True)
        )
    )
    pair, alone = merge_causes(errors, found.joints)
    assert pair.joints == ("hip", "knee") and alone.joints == ("foot",)
    assert pair.scope == "group" and alone.scope == "joint"
    assert pair.numbers[0].value == pytest.approx(0.52) and alone.numbers[0].value == 2.0
    assert [m.numbers[0].value for m in pair.members.values()] == [0.50, 0.54]


def test_precise_joints_count_more_where_they_agree(models):
    parts = [number("friction_nm", 0.5, 0.01), number("friction_nm", 0.54, 0.1)]
    found, errors = errors_of(
        *(made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", p)]) for m, p in zip(models, parts, strict=False))
    )
    (one,) = merge_causes(errors, found.joints)
    assert one.numbers[0].value == pytest.approx((0.5 + 0.54 / 100) / 1.01, rel=1e-6)


def test_precise_joints_that_differ_give_their_mean(models):
    parts = [number("friction_nm", value, half) for value, half in ((0.50, 0.001), (0.60, 0.004))]
    found, errors = errors_of(
        *(made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", p)]) for m, p in zip(models, parts, strict=False))
    )
    (one,) = merge_causes(errors, found.joints)
    low, high = one.numbers[0].ci95
    assert one.numbers[0].value == pytest.approx(0.55, rel=1e-3)
    assert high - low == pytest.approx(0.001 + 0.004, rel=0.01), "as sure as the middle one of the joints"


def test_what_shows_a_cause_is_told_by_joint_where_there_are_several(models):
    shows = replace(cause("stribeck_friction"), shown_by="the torque vibrates")
    found, errors = errors_of(*(made_up(m, 1.0, 0.5, causes=[shows]) for m in models[:2]))
    (both,) = merge_causes(errors, found.joints)
    assert both.shown_by == "hip: the torque vibrates; knee: the torque vibrates"
    found, errors = errors_of(made_up(models[0], 1.0, 0.5, causes=[shows]), made_up(models[1], 1.0, 0.5))
    (one,) = merge_causes(errors, found.joints)
    assert one.joints == ("hip",) and one.shown_by == "the torque vibrates"


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_number_that_is_like_none_other_is_a_cause_of_its_own(models, value):
    sizes = (0.5, value, value)
    found, errors = errors_of(
        *(
            made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", number("friction_nm", s, 0.05))])
            for m, s in zip(models, sizes, strict=True)
        )
    )
    joints = [one.joints for one in merge_causes(errors, found.joints)]
    assert ("hip",) in joints and sorted(j for each in joints for j in each) == ["foot", "hip", "knee"]


def test_units_are_never_pooled(models):
    parts = [number("friction_nm", 0.5, 0.1, unit) for unit in ("N·m", "N")]
    found, errors = errors_of(
        *(made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", p)]) for m, p in zip(models, parts, strict=False))
    )
    assert len(merge_causes(errors, found.joints)) == 2


def test_a_rival_of_most_joints_is_one_of_the_cause(models):
    rivals = [("stribeck_friction",), ("stribeck_friction",), ("spring",)]
    found, errors = errors_of(
        *(
            made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", rivals=r)])
            for m, r in zip(models, rivals, strict=True)
        )
    )
    (one,) = merge_causes(errors, found.joints)
    assert one.scope == "machine" and one.rivals == ("stribeck_friction",)


def test_shares_of_two_causes_are_those_of_all_subsets(models):
    found, errors = errors_of(
        made_up(models[0], 4.0, 1.0, causes=[cause("a"), cause("b")], without={"a": 3.0, "b": 2.0})
    )
    got = shares(errors, merge_causes(errors, found.joints))
    # falls of the error: a alone 4 → 2, b alone 4 → 3, both 4 → 1, over 4
    np.testing.assert_allclose(got.each, [(0.5 + 0.5) / 2, (0.25 + 0.25) / 2], rtol=1e-9)
    assert got.whole == pytest.approx(0.75) and got.each.sum() == pytest.approx(got.whole)


def test_shares_of_three_causes_add_up_and_follow_what_each_closes_last(models):
    without = {"a": 3.0, "b": 1.5, "c": 1.0}
    found, errors = errors_of(
        made_up(models[0], 4.0, 1.0, causes=[cause(name) for name in without], without=without),
        made_up(models[1], 1.0, 1.0),
    )
    got = shares(errors, merge_causes(errors, found.joints))
    assert got.each.sum() == pytest.approx(got.whole) and got.each[0] > got.each[1] > got.each[2]
    assert got.each[2] < 0.05 < got.each[1]
    assert (got.each_ci95[:, 0] <= got.each + 1e-9).all() and (got.each <= got.each_ci95[:, 1] + 1e-9).all()


def test_without_causes_there_is_no_shrink(models):
    found, errors = errors_of(made_up(models[0], 1.0, 1.0))
    got = shares(errors, merge_causes(errors, found.joints))
    assert len(got.each) == 0 and got.whole == 0.0


class Inverse:
    @staticmethod
    def reported(effect, name, value):
        return "effort_max_nm", 1.0 / value if value > 0.0 else np.inf, "N·m"


def test_a_number_is_told_in_the_form_that_is_meant():
    told = reporting(Inverse())("torque_limit", Number_(0.5, (0.4, 0.625), 0.25))
    assert (told.name, told.unit, told.value, told.reference) == ("effort_max_nm", "N·m", 2.0, 4.0)
    assert told.ci95 == pytest.approx((1.6, 2.5))


def test_an_interval_without_end_is_cut():
    told = reporting(Inverse())("torque_limit", Number_(0.5, (0.0, 1.0), 0.0))
    assert told.ci95 == pytest.approx((1.0, 2000.0)) and told.reference is None


def Number_(value, ci95, reference):
    return replace(number("inverse_effort_max", value, 0.0, "1"), ci95=ci95, reference=reference)


def test_what_was_absent_then_has_no_reference(models):
    parts = [number("friction_nm", 0.5, 0.01, reference=then) for then in (0.0, 0.3)]
    found, errors = errors_of(
        *(
            made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", p)])
            for m, p in zip(models[:1], parts[:1], strict=True)
        )
    )
    assert merge_causes(errors, found.joints)[0].numbers[0].reference is None
    found, errors = errors_of(made_up(models[0], 1.0, 0.5, causes=[cause("coulomb_friction", parts[1])]))
    assert merge_causes(errors, found.joints)[0].numbers[0].reference == 0.3


def test_a_lost_sign_is_told_of_the_joints_that_lost_it(models):
    lost = toy("hip", 0, seconds=6.0)
    lost.unsigned = True
    joints = layer_joints([lost, models[1]])
    assert unsigned_joints(joints) == ("hip",)


def test_a_number_that_is_known_exactly_or_not_at_all_is_pooled_within_its_bounds(models):
    for halves, low in (((0.0, 0.1), 0.45), ((0.3, 0.5), 0.0)):
        parts = [
            replace(n, ci95=(max(n.ci95[0], 0.0), n.ci95[1])) for n in (number("friction_nm", 0.5, h) for h in halves)
        ]
        found, errors = errors_of(
            *(made_up(m, 1.0, 0.5, causes=[cause("coulomb_friction", p)]) for m, p in zip(models, parts, strict=False))
        )
        (one,) = merge_causes(errors, found.joints)
        assert one.numbers[0].value == pytest.approx(0.5)
        assert one.numbers[0].ci95[0] >= low - 1e-9


def test_numbers_that_are_all_nought_keep_the_intervals_that_they_have(models):
    shapes = [number("time_constant_s", 0.01, 0.001), number("behind_edges", 0.0, 0.5)]
    found, errors = errors_of(*(made_up(m, 1.0, 0.5, causes=[cause("valve_lag", *shapes)]) for m in models))
    (merged,) = merge_causes(errors, found.joints)
    share = merged.numbers[1]
    assert share.value == 0.0 and 0.2 < share.ci95[1] <= 0.5


class SpoolJoint:
    """How a joint of the actuator layer reports a spool: the damping ratio by one over its square."""

    @staticmethod
    def reported(effect, name, value):
        if name != "damping_ratio":
            return name, value, "s"
        return name, 1.0 / np.sqrt(value) if value > 0.0 else np.inf, "1"


def spool(models, springy):
    """A lag of 20 ms in each joint, with 1/ζ² and its interval."""
    parts = [(number("time_constant_s", 0.02, 0.002, "s"), number("damping_ratio", w, 0.1, "1")) for w in springy]
    found, errors = errors_of(
        *(made_up(m, 1.0, 0.5, causes=[cause("valve_lag", *p)]) for m, p in zip(models, parts, strict=True))
    )
    return merge_causes(errors, found.joints, SpoolJoint)


def test_what_follows_from_the_numbers_of_an_effect_is_reported_beside_them(models):
    (lag,) = spool(models[:1], (1.5,))
    told = {n.name: n for n in lag.numbers}
    assert list(told) == ["time_constant_s", "damping_ratio", "natural_hz"]
    damping = 1.0 / np.sqrt(1.5)
    assert told["damping_ratio"].value == pytest.approx(damping)
    assert told["natural_hz"].value == pytest.approx(damping / (np.pi * 0.02)) and told["natural_hz"].unit == "Hz"
    low, high = told["natural_hz"].ci95
    assert high - low > damping / np.pi * (1.0 / 0.018 - 1.0 / 0.022), "no surer than the time constant"


def test_a_second_number_that_may_be_infinite_is_left_out(models):
    (lag,) = spool(models, (1.5, 1.5, 0.05))
    assert [n.name for n in lag.numbers] == ["time_constant_s", "damping_ratio", "natural_hz"], "most joints have it"
    assert [n.name for n in lag.members["foot"].numbers] == ["time_constant_s"]
    (lag,) = spool(models, (1.5, 0.05, 0.05))
    assert [n.name for n in lag.numbers] == ["time_constant_s"]
