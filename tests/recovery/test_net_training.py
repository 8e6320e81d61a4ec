"""Nets learn a machine of known law well enough to beat persistence, free-running."""

from __future__ import annotations

import numpy as np
import pytest
from hydraulic_truth import log_set, simulate

from hqpipe.sysid.baselines import Persistence
from hqpipe.sysid.free_run import predict
from hqpipe.sysid.nets.fit_net import KINDS, fit_paper_net, fit_strong_net

WINDOW = 100


@pytest.fixture(scope="module")
def logs():
    """Three joints, 2 N·m of noise on torques of some 300 N·m."""
    return log_set([simulate(6.0, 3, 2.0, 1), simulate(2.0, 3, 2.0, 2)], ["fit", "heldout"])


def rmse(logs, model, window):
    trial = logs.heldout[0].trajectory
    return np.sqrt(np.mean((predict(trial, model, window) - trial.effort)[1:] ** 2))


@pytest.mark.parametrize("kind", KINDS)
def test_training_beats_persistence(logs, kind):
    strong = fit_strong_net(logs, kind, warm_up=150, iterations=80, hidden=32, every=20)
    paper = fit_paper_net(logs, kind, iterations=150, batch=1000)
    still = rmse(logs, Persistence(), WINDOW)
    assert rmse(logs, paper.model, WINDOW) < 0.8 * still
    assert rmse(logs, strong.model, WINDOW) < 0.5 * still
    assert rmse(logs, strong.model, 1) < rmse(logs, Persistence(), 1)
