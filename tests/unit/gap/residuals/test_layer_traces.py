"""Traces round the worst stretch of each joint."""

from __future__ import annotations

import json

import numpy as np
import pytest
from layer_cases import WINDOW_S, layer_found, log_set, made_up, toy

from hqpipe.gap.residuals.layer_errors import layer_errors
from hqpipe.gap.residuals.layer_traces import SPAN_S, layer_traces

LENGTH = 3.0 * WINDOW_S  # s: three windows, which is more than SPAN_S


def traced(at, seconds=20.0, metric="free_run_rmse"):
    """Traces of a joint that is off by 50 for a block that begins at `at` s, with its causes by 5."""
    model = toy("hip", 1, seconds=seconds)
    made = made_up(model, 1e-3, 1e-4)
    inside = (model.heldout.time >= at) & (model.heldout.time < at + WINDOW_S)
    for fitted, size in ((made.base, 50.0), (made.named, 5.0)):
        fitted.heldout[inside] = size
    found, logs = layer_found(made, metric=metric), log_set([model])
    return layer_traces(layer_errors(found, logs), logs, found.joints)["joints"]["hip"], model


@pytest.mark.parametrize("at", [0.0, 9.0, 19.5])
def test_the_worst_stretch_is_shown_before_and_after(at):
    shown, model = traced(at)
    time = np.array(shown["time"])
    assert shown["trial"] == "c" and shown["unit"] == "N·m" and LENGTH > SPAN_S
    assert time[-1] - time[0] == pytest.approx(LENGTH, abs=2 * model.dt)
    assert time[0] <= at + 1e-9 and time[-1] >= at + WINDOW_S - 2 * model.dt
    assert {len(shown[name]) for name in ("position", "measured", "before", "after")} == {len(time)}
    off = np.array(shown["before"]) - np.array(shown["measured"])
    inside = (time > at + 1e-6) & (time < at + WINDOW_S - 1e-6)
    np.testing.assert_allclose(off[inside], 50.0, atol=1e-3)
    np.testing.assert_allclose(off[~inside & (np.abs(time - at) > 1e-6)], 0.0, atol=0.01)
    later = np.array(shown["after"]) - np.array(shown["measured"])
    np.testing.assert_allclose(later[inside], 5.0, atol=1e-3)
    first = int(round(time[0] / model.dt))
    assert shown["measured"][0] == pytest.approx(model.heldout.output[first], rel=1e-4)
    json.dumps(shown, allow_nan=False)


def test_restarts_are_those_of_the_windows():
    shown, _ = traced(9.0)
    restarts = np.array(shown["restarts"]) / WINDOW_S
    assert len(restarts) >= 2
    np.testing.assert_allclose(restarts, np.round(restarts), atol=1e-6)
    assert traced(9.0, metric="inverse_dynamics_rmse")[0]["restarts"] == [], "nothing is restarted"


def test_a_trial_shorter_than_the_span_is_shown_whole():
    shown, model = traced(0.0, seconds=1.0)
    assert len(shown["time"]) == len(model.heldout.time)
