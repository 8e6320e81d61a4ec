"""Timings pass results through and step what they say; how long it takes is nobody's business here."""

from __future__ import annotations

import numpy as np
from actuators.net_examples import random_net
from identify.small_logs import trajectory

from hqpipe.actuators.loops.free_run import step_along
from hqpipe.identify.rivals import timing
from hqpipe.identify.rivals.timing import step_time, timed


def test_result_comes_back_with_its_time():
    result, seconds = timed(lambda: "made")
    assert result == "made" and seconds >= 0.0


def test_a_step_is_measured_along_at_most_two_seconds(monkeypatch):
    calls = []

    def watched(kind, parameters, weights, columns, effort, *rest):
        calls.append((len(effort), rest[-1]))
        return step_along(kind, parameters, weights, columns, effort, *rest)

    monkeypatch.setattr(timing, "step_along", watched)
    model = random_net("gru", ("knee", "hip"))
    assert step_time(trajectory(samples=5000), model, window_s=0.05) >= 0.0
    assert set(calls) == {(2001, 50)}
    assert step_time(trajectory(samples=300), model) >= 0.0
    assert calls[-1] == (300, 100)


def test_stepping_along_is_what_the_simulator_does():
    """One copy, which keeps its memory while its torque is set to the log's."""
    trial = trajectory(samples=61)
    model = random_net("lstm", trial.joints)
    memory, torque = model.fresh_memory(1), trial.effort[:1].copy()
    for k in range(60):
        if k % 20 == 0:
            torque[:] = trial.effort[k]
        inputs = (a[k : k + 1] for a in (trial.position_command, trial.position, trial.velocity))
        model.step(torque, memory, *inputs, dt=1e-3)
    signals = (trial.effort, trial.position_command, trial.position, trial.velocity)
    found = step_along(model.KIND, model.parameters, model.weights, model.memory_columns, *signals, 20)
    np.testing.assert_array_equal(found, torque[0])
