"""What the logs of a joint show by themselves is a cause, unless the law of the joint explains what shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.found import Fitted, JointCause, JointFound
from hqpipe.identify.model import Shown
from hqpipe.identify.shown import SURE, with_shown


@dataclass(frozen=True)
class Model:
    shown: tuple[Shown, ...] = ()


class Wrapped:
    """One that looks like another model."""

    def __init__(self, model: Model) -> None:
        self._model = model

    def __getattr__(self, name: str):
        return getattr(self._model, name)


def joint(model: object, *, left: float, causes: tuple[JointCause, ...] = ()) -> JointFound:
    """left: root mean square of what its causes leave."""
    fitted = Fitted((), np.zeros(0), np.full(100, left), np.zeros(0))
    return JointFound(model, fitted, fitted, fitted, fitted, causes, {}, {}, {}, {})


SIGN = (Shown("stribeck_friction", "the torque vibrates", 8.0),)  # with an amplitude of 4


def test_a_sign_that_no_cause_explains_is_a_cause_without_numbers():
    (found,) = with_shown([joint(Model(SIGN), left=3.0)])
    assert found.causes == (JointCause("stribeck_friction", SURE, (), shown_by="the torque vibrates"),)
    assert found.without["stribeck_friction"] is found.named
    assert found.probabilities["stribeck_friction"] == SURE


def test_a_sign_that_the_law_predicts_is_none():
    (found,) = with_shown([joint(Model(SIGN), left=1.0)])
    assert found.causes == ()


def test_a_cause_that_was_found_keeps_its_numbers():
    cause = JointCause("stribeck_friction", 0.7, ("numbers",), ("coulomb_friction",))
    (found,) = with_shown([joint(Model(SIGN), left=3.0, causes=(cause,))])
    assert found.causes == (cause,)


def test_joints_without_a_sign_and_those_held_against_other_logs_stay_as_they_are():
    sound, without, wrapped = joint(Model(), left=3.0), joint(object(), left=3.0), joint(Wrapped(Model(SIGN)), left=3.0)
    found = with_shown([sound, without, wrapped])
    assert all(new is old for new, old in zip(found, [sound, without, wrapped], strict=True))
