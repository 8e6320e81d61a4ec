"""The compiled nets against the same nets in torch, teacher-forced and free-running."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from identify.small_logs import log_set, trajectory

from hqpipe.actuators import ACTUATOR_MODELS
from hqpipe.identify.free_run import predict
from hqpipe.identify.rivals.nets.data import net_data
from hqpipe.identify.rivals.nets.modules import NETS, actuator_of

STEPS = 30
CASES = [
    ("mlp", (0,), False),
    ("mlp", (0, 3, 9), True),
    ("lstm", (0,), False),
    ("lstm", (0,), True),
    ("gru", (0,), False),
    ("gru", (0,), True),
]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{len(case[1])}-{'change' if case[2] else 'torque'}")
def pair(request):
    """A net with torch's first weights, the model made of it, its log, and the log as one sequence."""
    kind, taps, delta = request.param
    trial = trajectory(samples=400)
    data = net_data(log_set(trial, trial).fit, delta=delta, errors=delta)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        net = NETS[kind](data, 16, taps)
    model = actuator_of(net, ACTUATOR_MODELS[kind], data, np.inf)
    return net, model, data, trial


def newton_metres(data, torque):
    mean, spread = (data.tensors[name][:2] for name in ("input_mean", "input_spread"))
    return mean + spread * torque.detach().numpy()[:, 0].astype(np.float64)


@pytest.mark.parametrize(("kind", "precision"), [(torch.float32, 1e-5), (torch.float64, 1e-7)])
def test_one_step_ahead(pair, kind, precision):
    net, model, data, trial = pair
    x, first = torch.tensor(data.inputs[:, None], dtype=kind), net.taps[-1]
    net = net.to(kind)
    following = net.following(x[first:-1, :, :2], net.outputs(x, first))
    found = predict(trial, model, 1)[first + 1 :]
    np.testing.assert_allclose(found, newton_metres(data, following), rtol=precision, atol=precision * 200.0)


@pytest.mark.parametrize(("kind", "precision"), [(torch.float32, 1e-5), (torch.float64, 1e-7)])
def test_free_running(pair, kind, precision):
    """The window that starts at row 3 W, after context from row 0 on."""
    net, model, data, trial = pair
    first = 3 * STEPS
    x = torch.tensor(data.inputs[: first + STEPS + 1, None], dtype=kind)
    expected = newton_metres(data, net.to(kind).free_run(x, first))
    found = predict(trial, model, STEPS)[first + 1 : first + STEPS + 1]
    np.testing.assert_allclose(found, expected, rtol=precision, atol=precision * 200.0)


def test_what_is_wanted_is_the_next_torque(pair):
    net, _, data, trial = pair
    x = torch.tensor(data.inputs[:, None], dtype=torch.float64)
    net = net.double()
    perfect = net.following(x[:-1, :, :2], net.wanted(x, 0))
    np.testing.assert_allclose(newton_metres(data, perfect), trial.effort[1:], rtol=1e-6, atol=1e-3)
