"""The flexible reference model finds what the remainder depends on, and nothing in noise."""

from __future__ import annotations

import numpy as np
import pytest

from hqpipe.gap.reference import explain
from hqpipe.gap.replay import replay

EFFECTS = {
    "position_error": lambda e, v, t: np.sign(e) * np.maximum(np.abs(e) - 0.005, 0.0),
    "time": lambda e, v, t: e * (1.0 - 0.02 * t),
    "velocity_sign": lambda e, v, t: np.where(v > 0, 0.9, 1.0) * e,
    "flow_of_other_joints": lambda e, v, t: e * (1.0 - 0.05 * np.abs(v[::-1])),
}


def explained(logs, model):
    fit, heldout = ([replay(t, model, 0.1) for t in trials] for trials in (logs.fit, logs.heldout))
    return explain(fit, heldout, 0, 0.95)


@pytest.mark.parametrize("signal", EFFECTS)
def test_the_planted_signal_is_found_first(make_logs, right_model, signal):
    logs = make_logs(effect=EFFECTS[signal])
    found = explained(logs, right_model(logs))
    assert next(iter(found.signals)) == signal
    assert found.after.sum() < 0.1 * found.before.sum()


def test_noise_is_not_explained(make_logs, right_model):
    logs = make_logs(drive_noise=1.0)
    found = explained(logs, right_model(logs))
    assert found.after.sum() > 0.97 * found.before.sum()
