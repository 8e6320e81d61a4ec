"""Effects that act for a part of a trial, where only sections of the trial were read."""

from __future__ import annotations

from dataclasses import replace

import pytest
from planted_logs import in_sections, logs_of

from hqpipe.gap.diagnosis import diagnose
from hqpipe.machine import EFFECTS

START, END = 8.0, 16.0  # s
WITHOUT = tuple(name for name in EFFECTS if name not in ("command_delay", "torque_bias", "valve_deadband"))


@pytest.fixture(scope="module")
def passing():
    """The torque sensor of the first joint is off for a third of each trial, of which every second 2 s were read."""
    log_set = logs_of([{}, {}], seconds=24.0, seed=4)

    def offset(t):
        effort = t.effort.copy()
        effort[(t.time >= START) & (t.time < END), 0] += 60.0
        return replace(t, effort=effort)

    whole = replace(log_set, trials=tuple(replace(x, trajectory=offset(x.trajectory)) for x in log_set.trials))
    return in_sections(whole, 2001, 4000)


@pytest.fixture(scope="module")
def content(passing):
    return diagnose(passing, without=WITHOUT).content


def test_a_stretch_reaches_over_sections_in_the_time_of_the_trial(content, passing):
    assert [(cause["effect"], cause["joints"]) for cause in content["causes"]] == [("torque_bias", ["LFR"])]
    assert content["causes"][0]["parameters"]["nm"]["value"] == pytest.approx(60.0, rel=0.05)
    assert "LFR: its causes act for some time only: 7.9 to 14 s of t1.parquet" in content["warnings"]


def test_trials_are_counted_as_recorded(content, passing):
    assert len(passing.trials) == 12
    assert content["logs"]["trials"] == 2
