"""A defect of the wiring is believed only if mending it helps the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken
from planted_logs import STEPS, logs_of

from hqpipe.gap.checks.confirm import confirmed
from hqpipe.gap.checks.defect import Defect


def files_of(logs):
    return tuple(t.file for t in logs.trials)


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


def shuffled(trajectory):
    order = np.random.default_rng(1).permutation(trajectory.samples)
    return replace(trajectory, **{name: values[order] for name, values in trajectory.channels().items()})


def test_random_order_is_confirmed_and_an_order_that_means_something_is_not(sound):
    logs = broken(sound, shuffled)
    assert confirmed(Defect("rows_out_of_order", files_of(logs), (), None, "text", fatal=True), logs, STEPS)
    assert not confirmed(Defect("rows_out_of_order", files_of(sound), (), None, "text", fatal=True), sound, STEPS)


def test_one_shuffled_channel_is_confirmed_and_a_sound_one_is_not(sound):
    logs = broken(sound, lambda t: replace(t, effort=np.where([True, False, False], shuffled(t).effort, t.effort)))
    assert confirmed(defect("rows_out_of_order", logs, sound.joints[:1], "effort"), logs, STEPS)
    assert not confirmed(defect("rows_out_of_order", sound, sound.joints[:1], "effort"), sound, STEPS)


def test_rows_that_step_backwards_are_confirmed_if_their_right_order_fits_better(sound):
    order = {t.file: np.arange(t.trajectory.samples)[::-1] for t in sound.trials}
    backwards = broken(sound, lambda t: replace(t, **{n: v[::-1] for n, v in t.channels().items()}))
    turned = Defect("rows_out_of_order", files_of(sound), (), None, "text", fatal=True, order=order)
    assert confirmed(turned, backwards, STEPS) and not confirmed(turned, sound, STEPS)


def test_a_dead_stretch_is_confirmed_by_its_windows(sound):
    still = np.arange(1000, 2500)

    def dead(t):
        effort = t.effort.copy()
        effort[still, 0] = effort[still[0], 0]
        return replace(t, effort=effort)

    logs = broken(sound, dead)
    rows = {(file, sound.joints[0]): still for file in files_of(sound)}
    found = replace(defect("constant", sound, sound.joints[:1], "effort"), rows=rows)
    assert confirmed(found, logs, STEPS) and not confirmed(found, sound, STEPS)


def test_a_sensor_slower_than_the_log_matters_where_joined_up_samples_fit_better(sound):
    def slow(every):
        return lambda t: replace(t, position=t.position[np.arange(t.samples) // every * every])

    found = defect("held_samples", sound, sound.joints[:1], "position")
    assert confirmed(found, broken(sound, slow(40)), STEPS) and not confirmed(found, sound, STEPS)


def test_other_defects_and_unused_channels_are_taken_as_found(sound):
    assert confirmed(defect("too_short", sound, ()), sound, STEPS)
    assert confirmed(defect("swapped", sound, sound.joints[:2], "pressure_a"), sound, STEPS)
