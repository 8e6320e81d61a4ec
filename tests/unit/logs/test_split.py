"""What is held back of the fit trials for a choice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hqpipe.logs.split import fit_sections, hold_back
from hqpipe.logs.trajectory import LogSet, Trajectory, Trial, recording_of


def log_set() -> LogSet:
    trials = []
    for name, split, samples in (("a", "fit", 20000), ("b", "fit", 10000), ("c", "heldout", 5000)):
        values = np.arange(samples, dtype=float)[:, None]
        t = Trajectory(np.arange(samples) * 1e-3, ("knee",), values, values, effort=values, position_command=values)
        trials.append(Trial(name, split, {"vx": 0.4}, t))
    return LogSet(Path("x"), "0", "f", None, None, "position", None, 1000.0, ("knee",), tuple(trials))


def test_every_fit_trial_gives_a_beginning_and_an_end():
    part = hold_back(log_set())
    assert [(t.file, t.split) for t in part.trials] == [("a", "fit"), ("a", "heldout"), ("b", "fit"), ("b", "heldout")]
    for file, samples in (("a", 20000), ("b", 10000)):
        first, last = [t.trajectory.effort[:, 0] for t in part.trials if t.file == file]
        assert first[0] == 0.0 and last[-1] == samples - 1
        assert len(last) == 0.3 * samples and last[0] - first[-1] > 400, (
            "a gap of half a second, so that no state is shared"
        )


def test_parts_keep_their_time_in_the_recording():
    part = hold_back(log_set()).trials[1]
    assert recording_of(part) == "a" and part.trajectory.time[0] == 0.0
    assert part.trajectory.start == pytest.approx(14.0) and part.trajectory.whole == pytest.approx(19.999)
    again = hold_back(hold_back(log_set())).trials[1]
    assert again.trajectory.start == pytest.approx(0.7 * 13.5)


def test_of_long_trials_sections_are_taken():
    whole, some = fit_sections(log_set()), fit_sections(log_set(), most=20000)
    assert [t.trajectory.samples for t in whole.trials] == [20000, 10000]
    assert [(recording_of(t), t.trajectory.start, t.trajectory.samples) for t in some.trials] == [
        ("a", 0.0, 10000),
        ("b", 0.0, 10000),
    ]
    assert [t.trajectory.samples for t in hold_back(log_set(), most=20000).heldout] == [3000, 3000]
