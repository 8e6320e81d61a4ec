"""Training of nets: what it sees, what it keeps, and that it is the same twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from identify.small_logs import log_set, trajectory

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.errors import IdentificationError, UsageError
from hqpipe.identify.free_run import predict
from hqpipe.identify.rivals.nets.data import net_data
from hqpipe.identify.rivals.nets.fit_net import KINDS, fit_paper_net, fit_strong_net

QUICK = {"warm_up": 3, "iterations": 4, "hidden": 4, "windows": 2, "every": 2, "window_s": 0.02}


@pytest.fixture
def logs():
    return log_set(trajectory(), trajectory(seed=1), trajectory(seed=2))


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_net(logs, kind):
    threads = torch.get_num_threads()
    torch.manual_seed(5)
    before = torch.random.get_rng_state()
    for fit, options in ((fit_paper_net, {"iterations": 3, "hidden": 4, "batch": 100}), (fit_strong_net, QUICK)):
        one, two, other = (fit(logs, kind, seed=seed, **options) for seed in (1, 1, 2))
        np.testing.assert_array_equal(one.model.weights, two.model.weights)
        assert (one.losses, one.stopping, one.best) == (two.losses, two.stopping, two.best)
        assert (one.model.weights != other.model.weights).any()
        assert one.trials == ("t0.parquet", "t1.parquet") and type(one.model) is ACTUATOR_MODELS[kind]
        assert one.model.per_joint is (fit is fit_strong_net)
    assert torch.get_num_threads() == threads and torch.equal(torch.random.get_rng_state(), before)


@pytest.mark.parametrize("kind", KINDS)
def test_held_out_trials_are_not_touched(logs, kind):
    """With a held-out trial that nothing could be computed from, the nets come out the same."""
    trap = replace(logs.trials[2], trajectory=None)
    blind = replace(logs, trials=(*logs.trials[:2], trap))
    for fit, options in ((fit_paper_net, {"iterations": 2, "hidden": 4, "batch": 100}), (fit_strong_net, QUICK)):
        found, expected = (fit(seen, kind, **options).model.weights for seen in (blind, logs))
        np.testing.assert_array_equal(found, expected)


def test_what_stops_a_training_is_not_trained_on():
    trials = log_set(trajectory(), trajectory(samples=20_000), trajectory(samples=50)).fit
    data = net_data(trials, delta=True, stopping=True)
    assert data.stretches == ((0, 450), (600, 600 + 15_500)) and data.stopping == ((480, 600), (16_600, 20_600))
    for parts in (data.stretches, data.stopping):
        starts = data.starts(parts, 100)
        inside = [any(a <= s and s + 100 <= b for a, b in parts) for s in starts]
        assert all(inside) and len(starts) == sum(b - a - 99 for a, b in parts)


def test_the_best_weights_are_kept(logs):
    found = fit_strong_net(logs, "mlp", **QUICK | {"iterations": 40, "learning_rate": 0.3, "patience": 3})
    rmse = dict(found.stopping)
    assert found.best == min(rmse, key=rmse.get) and len(found.losses) < 43, "it went on after it had become worse"
    assert [iteration for iteration, _ in found.stopping] == list(range(3, len(found.losses) + 1, 2))


def test_the_error_that_stops_is_that_of_the_free_run(logs):
    """N·m, on the model that is handed back, in windows behind 20 ms of context."""
    found, trial = fit_strong_net(logs, "mlp", **QUICK), logs.fit[1].trajectory
    error = []
    for t in (logs.fit[0].trajectory, trial):
        for start in range(480, 600 - 40, 20):
            part = t.section(start, start + 41)
            error.append((predict(part, found.model, 20) - part.effort)[21:])
    assert np.sqrt(np.mean(np.square(error))) == pytest.approx(dict(found.stopping)[found.best], rel=1e-4)


def test_a_signal_that_does_not_move_divides_nothing_by_zero(logs):
    still = trajectory(position_command=np.full((600, 2), 0.3))
    found = fit_paper_net(log_set(still, still), "gru", iterations=2, hidden=4, batch=100)
    assert np.isfinite(found.model.weights).all()
    np.testing.assert_array_equal(found.model.tensors["input_spread"][2:4], 1.0)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"kind": "gur"}, UsageError, "kind is 'gur' – did you mean 'gru'"),
        ({"hidden": 0}, UsageError, "hidden is 0, expected at least 1"),
        ({"learning_rate": 1e30, "iterations": 20}, IdentificationError, "diverged after .* smaller learning_rate"),
        ({"window_s": 0.5}, IdentificationError, r"needs 521 samples in one piece \(0.521 s\), the longest.* has 450"),
        ({"effort_limit": {"hip": 1.0}}, UsageError, "effort_limit: no value for joint 'knee'"),
    ],
)
def test_nonsense_is_refused(logs, options, error, words):
    with pytest.raises(error, match=words):
        fit_strong_net(logs, options.pop("kind", "mlp"), **QUICK | options)


def test_missing_channels_are_named(logs):
    blind = trajectory(position_command=None)
    with pytest.raises(IdentificationError, match="a net needs joint/<name>/position_command"):
        fit_paper_net(log_set(blind, blind), "mlp")
