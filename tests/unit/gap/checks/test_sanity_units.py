"""A trial in another unit is found; one that moves other joints is not taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plant_logs import broken, plant_logs, recorded

from hqpipe.gap.checks.sanity_units import unit_defects
from hqpipe.logs.trajectory import Excerpt

SEEDS = (0, 1, 2, 3)
COUNT = 4e-4  # rad, of an encoder of 14 bits


def scaled(factor):
    return lambda t: replace(t, position=factor * t.position)


@pytest.mark.parametrize(("factor", "unit"), [(180 / np.pi, "degrees"), (1000.0, "mm")])
def test_a_trial_in_another_unit(factor, unit):
    (found,) = unit_defects(broken(plant_logs(SEEDS), scaled(factor), [1]))
    assert found.trials == ("t1.parquet",) and unit in found.message and found.factor == pytest.approx(factor)


def test_a_trial_that_moves_joints_that_rest_elsewhere_is_in_no_other_unit():
    """Where each trial moves other joints, most of what a joint does elsewhere is a count or two, or a little shaking."""
    logs = plant_logs(SEEDS)
    rng = np.random.default_rng(0)

    def resting(t):
        counts = COUNT * np.round(0.3 * rng.standard_normal(t.position.shape))
        shaken = np.arange(len(t.joints)) < 3
        return replace(t, position=t.position[0] + np.where(shaken, 1e-2 * (t.position - t.position[0]), counts))

    assert unit_defects(broken(logs, resting, [0, 2, 3])) == []


def test_sections_of_one_recording_are_in_one_unit():
    """Between gaps a joint may hardly move in most sections and sweep in one."""
    whole = recorded(0)
    cuts = [(0, 300), (300, 600), (600, 900), (900, whole.samples)]
    sections = [whole.section(*cut) for cut in cuts]
    small = [
        replace(s, position=s.position.mean(axis=0) + 0.02 * (s.position - s.position.mean(axis=0)))
        for s in sections[:3]
    ]
    logs = plant_logs(SEEDS)
    trials = [
        replace(trial, trajectory=replace(s, excerpt=Excerpt("a.parquet", 0.0, whole.duration)))
        for trial, s in zip(logs.trials, [*small, sections[3]], strict=True)
    ]
    assert unit_defects(replace(logs, trials=tuple(trials))) == []
