"""Nets learn a machine of known law: with every advantage well enough to beat persistence, free-running."""

from __future__ import annotations

import numpy as np
import pytest
from hydraulic_truth import log_set, simulate

from hqpipe.identify.free_run import predict
from hqpipe.identify.rivals.baselines import Persistence
from hqpipe.identify.rivals.nets.fit_net import KINDS, fit_paper_net, fit_strong_net

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
    assert rmse(logs, strong.model, WINDOW) < 0.8 * rmse(logs, Persistence(), WINDOW)
    assert rmse(logs, strong.model, 1) < rmse(logs, Persistence(), 1)


@pytest.mark.parametrize("kind", KINDS)
def test_training_as_the_paper_does_it_predicts_the_next_torque(logs, kind):
    paper, effort = fit_paper_net(logs, kind, iterations=150, batch=1000), logs.heldout[0].trajectory.effort
    assert rmse(logs, paper.model, 1) < 0.3 * effort.std()
