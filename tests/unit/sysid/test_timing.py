"""Timings pass results through and replay what they say; how long it takes is nobody's business here."""

from __future__ import annotations

from small_logs import trajectory

from hqpipe.sysid.timing import step_time, timed


class Watched:
    def __init__(self):
        self.calls = []

    def predict(self, trajectory, window):
        self.calls.append((trajectory.samples, window))
        return trajectory.effort


def test_result_comes_back_with_its_time():
    result, seconds = timed(lambda: "made")
    assert result == "made" and seconds >= 0.0


def test_a_step_is_measured_free_running_on_at_most_two_seconds():
    model = Watched()
    assert step_time(trajectory(samples=5000), model, window_s=0.05) >= 0.0
    assert set(model.calls) == {(2001, 50)}
    assert step_time(trajectory(samples=300), model) >= 0.0
    assert model.calls[-1] == (300, 100)
