"""A logged supply pressure tells whether the supply can be a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted_logs import logs_of

from hqpipe.gap.supply import is_steady, without_steady

NOMINAL = 1.6e7  # Pa
NAMES = ("valve_lag", "supply_droop")


@pytest.fixture(scope="module")
def logs():
    return logs_of([{}], seconds=2.0)


def with_pressure(logs, *shares):
    """The logs with a pressure that dips to a share of the nominal one, a share per trial; None logs none."""
    trials = []
    for trial, share in zip(logs.trials, shares, strict=True):
        t = trial.trajectory
        dip = 1.0 - (1.0 - (share or 1.0)) * np.sin(np.pi * t.time / t.duration) ** 2
        extra = {} if share is None else {"supply/pressure": NOMINAL * dip}
        trials.append(replace(trial, trajectory=replace(t, extra=extra)))
    return replace(logs, trials=tuple(trials))


@pytest.mark.parametrize(
    "shares,steady", [((1.0, 1.0), True), ((0.99, 0.99), True), ((1.0, 0.9), False), ((None, 1.0), False)]
)
def test_steady_where_every_trial_shows_it(logs, shares, steady):
    assert is_steady(with_pressure(logs, *shares)) == steady
    expected = ("valve_lag",) if steady else NAMES
    assert without_steady(NAMES, with_pressure(logs, *shares)) == expected


def test_nothing_is_known_of_a_pressure_that_was_not_logged(logs):
    assert without_steady(NAMES, logs) == NAMES


def test_spikes_of_the_sensor_are_no_sag(logs):
    steady = with_pressure(logs, 1.0, 1.0)
    steady.trials[0].trajectory.extra["supply/pressure"][[100, 900]] = 0.5 * NOMINAL
    assert is_steady(steady)
