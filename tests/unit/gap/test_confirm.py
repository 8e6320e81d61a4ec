"""A defect of the wiring is believed only if mending it helps the model."""

from __future__ import annotations

from dataclasses import replace

import pytest
from plant_logs import broken
from planted_logs import STEPS, logs_of

from hqpipe.gap.confirm import confirmed
from hqpipe.gap.defect import Defect


def defect(kind, logs, joints, channel="position_command"):
    return Defect(kind, tuple(t.file for t in logs.trials), joints, channel, "text", fatal=True)


@pytest.fixture(scope="module")
def sound():
    return logs_of([{}, {}, {}], seconds=4.0)


def test_true_swap_is_confirmed_and_a_false_one_is_not(sound):
    swapped = broken(sound, lambda t: replace(t, position_command=t.position_command[:, [1, 0, 2]]))
    assert confirmed(defect("swapped", swapped, sound.joints[:2]), swapped, STEPS)
    assert not confirmed(defect("swapped", sound, sound.joints[:2]), sound, STEPS)


def test_cycle_of_three_is_turned_either_way(sound):
    turned = broken(sound, lambda t: replace(t, position_command=t.position_command[:, [2, 0, 1]]))
    assert confirmed(defect("swapped", turned, sound.joints), turned, STEPS)


def test_true_sign_flip_is_confirmed_and_a_false_one_is_not(sound):
    flipped = broken(sound, lambda t: replace(t, effort=t.effort * [1.0, -1.0, 1.0]))
    assert confirmed(defect("sign_flipped", flipped, sound.joints[1:2], "effort"), flipped, STEPS)
    assert not confirmed(defect("sign_flipped", sound, sound.joints[1:2], "effort"), sound, STEPS)


def test_other_defects_and_unused_channels_are_taken_as_found(sound):
    assert confirmed(defect("too_short", sound, ()), sound, STEPS)
    assert confirmed(defect("swapped", sound, sound.joints[:2], "pressure_a"), sound, STEPS)
