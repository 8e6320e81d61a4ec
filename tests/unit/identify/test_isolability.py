"""Which effects a joint could show, and which it cannot tell apart, before anything is searched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.effect_secants import EffectSecants
from hqpipe.identify.identify import identify
from hqpipe.identify.isolability import isolability
from hqpipe.identify.model import Effect, LayerJoints, Parameter
from hqpipe.identify.prior import prior_odds
from hqpipe.identify.search import Search


class Extended(ToyJoint):
    """The joint with more effects, each linear in one number.

    Args:
        columns: effect → what a size of 1 does, from the regressors (7, N) of the joint. low: effect → lower bound.
    """

    def __init__(self, columns, low=None, **more):
        super().__init__(**more)
        self.effects = (
            *self.effects,
            *(Effect(name, (Parameter("size", "1", 0.0, 0.5, (low or {}).get(name, -np.inf)),)) for name in columns),
        )
        self._fit, self._heldout = (
            np.vstack([part, *(column(part) for column in columns.values())]) for part in (self._fit, self._heldout)
        )


def found(joint):
    return isolability(Search(joint, prior_odds(joint, {}, 0)))


def causes(joint):
    layer = LayerJoints("joint_motion", "rmse", 0.1, "", (joint,))
    return {cause.effect for cause in identify(layer).found[0].causes}


@pytest.mark.parametrize("effect", ["coulomb_friction", "viscous_friction", "spring"])
def test_an_effect_is_named_above_the_reported_size_and_not_below(effect):
    least = found(ToyJoint(seed=1))[effect].least
    assert found(ToyJoint(seed=1))[effect].shows
    assert [effect in causes(ToyJoint(truth={effect: factor * least}, seed=1)) for factor in (0.5, 2.0)] == [
        False,
        True,
    ]


def test_beside_a_gap_an_effect_has_to_be_larger():
    before = found(ToyJoint(unknown=1.0, seed=1))["spring"]
    assert before.least_beside_base_error > 3.0 * before.least
    clean = found(ToyJoint(seed=1))["spring"]
    assert clean.least_beside_base_error == pytest.approx(clean.least, rel=0.3)


def test_noise_hides_what_is_usual():
    spring = found(ToyJoint(noise=10.0, seed=1))["spring"]
    assert not spring.shows and spring.least > 1.5 and spring.alike == ()
    assert found(ToyJoint(noise=1000.0, seed=1))["spring"].least is None


def test_what_matters_too_little_is_not_named():
    """Half a per cent of the spread of the torque, however small the noise."""
    spread = np.std(ToyJoint(noise=0.001, seed=1).fit.output)
    sizes = [found(ToyJoint(noise=noise, seed=1))["spring"].least for noise in (1e-6, 0.001)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.01) and sizes[0] > 0.005 * spread


def test_what_the_base_can_do_does_not_show():
    joint = Extended({"bias": lambda part: part[1], "ghost": lambda part: 0.0 * part[0]}, seed=1)
    bias, ghost = found(joint)["bias"], found(joint)["ghost"]
    assert not bias.shows and bias.least is None and bias.share_done_by_base == pytest.approx(1.0)
    assert not ghost.shows and ghost.share_done_by_base is None, "it does nothing by itself"


def test_effects_with_one_shape_are_alike_and_others_are_not():
    joint = Extended({"seal": lambda part: np.tanh(20.0 * part[3])}, seed=1)
    answer = found(joint)
    assert answer["coulomb_friction"].alike == ("seal",) and answer["seal"].alike == ("coulomb_friction",)
    assert answer["spring"].alike == () == answer["viscous_friction"].alike
    assert set(answer) == {"coulomb_friction", "viscous_friction", "spring", "seal"}, "a generic shape has no name"


def test_a_bound_keeps_an_effect_from_imitating_its_opposite():
    def push(part):
        return -part[2]

    assert found(Extended({"push": push}, seed=1))["coulomb_friction"].alike == ("push",)
    assert found(Extended({"push": push}, {"push": 0.0}, seed=1))["coulomb_friction"].alike == ()


def test_an_effect_with_more_numbers_is_not_taken_for_one_with_fewer():
    def two(first, second):
        joint = Extended({"pair": first, "rest": second}, seed=1)
        pair = Effect("pair", (*joint.effects[-2].parameters, *joint.effects[-1].parameters))
        joint.effects = (*joint.effects[:-2], pair)
        return found(joint)

    other = two(lambda part: np.sin(7.0 * part[4]), lambda part: part[2])
    assert other["coulomb_friction"].alike == () == other["pair"].alike
    same = two(lambda part: part[2], lambda part: np.sin(7.0 * part[4]))
    assert same["coulomb_friction"].alike == ("pair",)


def test_the_shape_of_an_effect_costs_no_evidence():
    def pair(shape):
        joint = Extended({"first": lambda part: part[4] ** 3, "rest": lambda part: part[2]}, seed=1)
        size, other = joint.effects[-2].parameters[0], replace(joint.effects[-1].parameters[0], shape=shape)
        joint.effects = (*joint.effects[:-2], Effect("pair", (size, other)))
        return found(joint)["coulomb_friction"].alike

    assert pair(shape=False) == () and pair(shape=True) == ("pair",)


def test_an_effect_that_acts_in_one_direction_is_compared_in_that_direction():
    joint = Extended({"one_sided": lambda part: np.sin(7.0 * part[4])}, seed=1)
    size = Parameter("size", "1", 0.0, 0.5, starts=(0.5, -0.5))
    joint.effects = (*joint.effects[:-1], Effect("one_sided", (size,)))
    linear = joint.error

    def error(values, heldout=False):
        return linear(np.array([*values[:-1], max(values[-1], 0.0)]), heldout)

    joint.error = error
    answer = found(joint)
    assert answer["one_sided"].shows and all(each.alike == () for each in answer.values())


def test_a_secant_takes_one_prediction():
    joint, asked = ToyJoint(seed=1), []
    search, error = Search(joint, prior_odds(joint, {}, 0)), joint.error
    secants = EffectSecants(search)
    joint.error = lambda values, heldout=False: asked.append(values) or error(values, heldout)
    (direction,) = secants.by_direction("coulomb_friction")
    assert len(asked) == len(direction)


def test_an_overflowing_base_says_nothing():
    joint = ToyJoint(seed=1)
    joint.error = lambda values, heldout=False: np.full(len(joint.fit.time), np.inf)
    assert found(joint) == {}
