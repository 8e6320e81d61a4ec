"""What vibrates beyond the law of a joint shows the effect that feeds it, unless that effect is a cause already."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.identify.found import Fitted, JointCause, JointFound
from hqpipe.identify.model import Samples
from hqpipe.identify.shown import SURE, with_shown
from hqpipe.identify.vibration_left import vibration_left

LENGTH = 2000
_ORDER = np.arange(LENGTH)
SLIDES = _ORDER % 500 > 250
SAMPLES = Samples(
    ("a",),
    np.zeros(LENGTH, dtype=np.int64),
    0.005 * _ORDER,
    np.zeros(LENGTH),
    SLIDES * (1.0 + 0.5 * np.sin(0.01 * _ORDER)),
    10.0 * np.sin(0.02 * _ORDER),
    np.zeros(LENGTH),
)
ERROR = 0.1 * np.random.default_rng(0).standard_normal(LENGTH) + 5.0 * SLIDES * np.sin(2.4 * _ORDER)


@dataclass(frozen=True)
class Model:
    vibration_shows: str = "stribeck_friction"
    fit: Samples = SAMPLES
    unit: str = "N·m"


class Wrapped:
    """One that looks like another model."""

    def __init__(self, model: Model) -> None:
        self._model = model

    def __getattr__(self, name: str):
        return getattr(self._model, name)


@dataclass(frozen=True)
class Plain:
    fit: Samples = SAMPLES
    unit: str = "N·m"


def joint(model: object, error: np.ndarray = ERROR, causes: tuple[JointCause, ...] = ()) -> JointFound:
    """error: what its causes leave."""
    fitted = Fitted((), np.zeros(0), error, np.zeros(0))
    return JointFound(model, fitted, fitted, fitted, fitted, causes, {}, {}, {}, {})


def test_a_vibration_that_no_cause_explains_shows_a_cause_without_numbers():
    (found,) = with_shown([joint(Model())])
    text = vibration_left(ERROR, SAMPLES).text("N·m")
    assert found.causes == (JointCause("stribeck_friction", SURE, (), shown_by=text),)
    assert found.without["stribeck_friction"] is found.named
    assert found.probabilities["stribeck_friction"] == SURE


def test_one_that_the_law_explains_shows_nothing():
    (found,) = with_shown([joint(Model(), 0.1 * ERROR)])
    assert found.causes == ()


def test_a_cause_that_was_found_keeps_its_numbers():
    cause = JointCause("stribeck_friction", 0.7, ("numbers",), ("coulomb_friction",))
    (found,) = with_shown([joint(Model(), causes=(cause,))])
    assert found.causes == (cause,)


def test_joints_in_which_it_shows_nothing_and_those_held_against_other_logs_stay_as_they_are():
    joints = [joint(Model("")), joint(Plain()), joint(Wrapped(Model()))]
    assert all(new is old for new, old in zip(with_shown(joints), joints, strict=True))
