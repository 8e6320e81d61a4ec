"""Traces round the worst window of each joint."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from planted_logs import STEPS, logs_of

from hqpipe.gap.replay import Replay
from hqpipe.gap.traces import SPAN_S, worst_windows


def replays(logs, at, size):
    """A prediction that is off by `size` in the window that starts at sample `at` of the last trial."""
    found = []
    for trial in logs.trials:
        predicted = trial.trajectory.effort.copy()
        if trial is logs.trials[-1]:
            predicted[at + 1 : at + STEPS + 1] += size
        found.append(Replay(trial.file, trial.trajectory, STEPS, predicted, predicted))
    return found


@pytest.fixture(scope="module")
def logs():
    return logs_of([{}, {}], seconds=3.0, noise=0.0)


@pytest.mark.parametrize("at", [0, 1400, 2800])
def test_the_worst_window_is_shown_before_and_after(logs, at):
    traces = worst_windows(replays(logs, at, 50.0), replays(logs, at, 5.0), logs)
    assert set(traces["joints"]) == set(logs.joints)
    assert {shown["unit"] for shown in traces["joints"].values()} == {"N·m"}
    for j, joint in enumerate(logs.joints):
        shown = traces["joints"][joint]
        assert shown["trial"] == logs.trials[-1].file
        time = np.array(shown["time"])
        assert len(time) == round(SPAN_S * 1e3)
        assert time[0] <= at * 1e-3 and time[-1] >= (at + STEPS - 1) * 1e-3
        lengths = {len(shown[name]) for name in ("command", "position", "measured", "before", "after")}
        assert lengths == {len(time)}
        off = np.array(shown["before"]) - np.array(shown["measured"])
        inside = (time > at * 1e-3 + 5e-4) & (time < (at + STEPS) * 1e-3 + 5e-4)
        np.testing.assert_allclose(off[inside], 50.0, atol=0.05)
        np.testing.assert_allclose(off[~inside], 0.0, atol=0.05)
        later = np.array(shown["after"]) - np.array(shown["measured"])
        np.testing.assert_allclose(later[inside], 5.0, atol=0.05)
        restarts = np.array(shown["restarts"])
        np.testing.assert_allclose(restarts / 0.1, np.round(restarts / 0.1), atol=1e-6)
        measured = logs.trials[-1].trajectory.effort[round(time[0] * 1e3), j]
        assert shown["measured"][0] == pytest.approx(measured, rel=1e-4)
    json.dumps(traces, allow_nan=False)


def test_a_trial_shorter_than_the_span_is_shown_whole(logs):
    short = replace(logs, trials=tuple(replace(t, trajectory=t.trajectory.section(0, 301)) for t in logs.trials))
    traces = worst_windows(replays(short, 100, 50.0), replays(short, 100, 0.0), short)
    assert all(len(shown["time"]) == 301 for shown in traces["joints"].values())
