"""Steps that several joints of a machine take at once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identify.toy_joint import ToyJoint

from hqpipe.identify.found import JointCause
from hqpipe.identify.joint_moves import Step, best_step, settled_together
from hqpipe.identify.prior import log_prior, prior_odds
from hqpipe.identify.shared_names import with_shared_names

MODEL = ToyJoint(seconds=1.0)
SPRING, FRICTION = frozenset({"spring"}), frozenset({"coulomb_friction"})
OTHER_NAME = Step("spring", "coulomb_friction")


def _effect(name):
    return next(effect for effect in MODEL.effects if effect.name == name)


@pytest.mark.parametrize("name", ["spring", "coulomb_friction"])
def test_the_odds_of_a_joint_beside_others_follow_from_the_prior_of_the_machine(name):
    joints = 6
    for others in range(joints):
        with_it, without = log_prior(MODEL, _effect(name), np.array([others + 1, others]), joints)
        assert prior_odds(MODEL, {name: others}, joints - 1)[name] == pytest.approx(with_it - without)


def test_joints_that_are_no_better_off_alone_change_their_name_together():
    present = [SPRING] * 5 + [FRICTION] * 5
    doubtful = {OTHER_NAME: -0.5, Step("spring", None): -50.0}
    step, joints = best_step([MODEL] * 10, present, [doubtful] * 5 + [{}] * 5)
    assert (step, joints) == (OTHER_NAME, [0, 1, 2, 3, 4])


def test_a_joint_whose_logs_tell_the_two_apart_keeps_its_name():
    present = [SPRING] * 5 + [FRICTION] * 5
    worths = [{OTHER_NAME: -40.0}, *[{OTHER_NAME: -0.5}] * 4, *[{}] * 5]
    assert best_step([MODEL] * 10, present, worths) == (OTHER_NAME, [1, 2, 3, 4])


def test_nothing_moves_where_no_step_helps():
    worths = [{OTHER_NAME: -40.0, Step(None, "coulomb_friction"): -30.0, Step("spring", None): -np.inf}] * 3
    assert best_step([MODEL] * 3, [SPRING] * 3, worths)[1] == []


def test_steps_end_when_none_is_left():
    asked = []

    def moved(steps):
        asked.append(steps)
        return {j: (step.of(SPRING), {}) for j, (step, _) in steps.items()}

    worths = [{OTHER_NAME: 9.0}] * 2 + [{}]
    assert settled_together([MODEL] * 3, [SPRING] * 3, worths, moved) == [FRICTION, FRICTION, SPRING]
    (steps,) = asked
    assert steps == {0: (OTHER_NAME, [FRICTION, SPRING]), 1: (OTHER_NAME, [FRICTION, SPRING])}


def test_a_step_that_a_joint_takes_back_is_not_asked_for_again():
    asked = []

    def moved(steps):
        asked.append(steps)
        return {j: (SPRING, {OTHER_NAME: 9.0}) for j in steps}

    assert settled_together([MODEL] * 3, [SPRING] * 3, [{OTHER_NAME: 9.0}, {}, {}], moved) == [SPRING] * 3
    assert len(asked) == 1


def _answer(effect, *alike):
    return SimpleNamespace(causes=(JointCause(effect, 0.9, (), alike),))


def test_a_joint_that_cannot_tell_two_names_apart_takes_that_of_the_others():
    answers = [_answer("spring", "coulomb_friction"), *[_answer("coulomb_friction", "spring")] * 3, _answer("spring")]
    found = with_shared_names(answers, lambda steps: {j: _answer(step.joins, step.leaves) for j, step in steps.items()})
    assert [joint.causes[0].effect for joint in found] == ["coulomb_friction"] * 4 + ["spring"]
