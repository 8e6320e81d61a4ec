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
    (kind, taps, delta, per_joint)
    for kind, taps, delta in (
        ("mlp", (0,), False),
        ("mlp", (0, 3, 9), True),
        ("lstm", (0,), False),
        ("lstm", (0,), True),
        ("gru", (0,), False),
        ("gru", (0,), True),
    )
    for per_joint in (False, True)
]


def named(case):
    kind, taps, delta, per_joint = case
    return f"{kind}-{len(taps)}-{'change' if delta else 'torque'}-{'each' if per_joint else 'all'}"


@pytest.fixture(params=CASES, ids=named)
def pair(request):
    """Nets with their first weights, the model made of them, their log, and the log as one sequence."""
    kind, taps, delta, per_joint = request.param
    trial = trajectory(samples=400)
    data = net_data(log_set(trial, trial).fit, delta=delta, errors=delta)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        net = NETS[kind](data, 16, taps, per_joint=per_joint)
    model = actuator_of(net, ACTUATOR_MODELS[kind], data, np.inf)
    return net, model, data, trial


def sequence(net, data, rows=None, kind=torch.float64):
    return net.sequence(torch.tensor(data.inputs[:rows, None], dtype=kind))


def newton_metres(net, data, torque):
    mean, spread = (data.tensors[name][:2] for name in ("input_mean", "input_spread"))
    return mean + spread * net.for_joints(torque).detach().numpy()[:, 0].astype(np.float64)


@pytest.mark.parametrize(("kind", "precision"), [(torch.float32, 1e-5), (torch.float64, 1e-6)])
def test_one_step_ahead(pair, kind, precision):
    net, model, data, trial = pair
    x, first = sequence(net, data, kind=kind), net.taps[-1]
    net = net.to(kind)
    # each row is followed on its own: rows take the place of a batch
    logged, out = (part.movedim(2, 1)[:, 0] for part in (x[:, first:-1, :, : net.joints], net.outputs(x, first)))
    following = net.following(logged, out)[:, :, None]
    found = predict(trial, model, 1)[first + 1 :]
    np.testing.assert_allclose(found, newton_metres(net, data, following), rtol=precision, atol=precision * 200.0)


@pytest.mark.parametrize(("kind", "precision"), [(torch.float32, 1e-5), (torch.float64, 1e-6)])
def test_free_running(pair, kind, precision):
    """The window that starts at row 3 W, after context from row 0 on."""
    net, model, data, trial = pair
    first = 3 * STEPS
    x = sequence(net, data, first + STEPS + 1, kind)
    expected = newton_metres(net, data, net.to(kind).free_run(x, first))
    found = predict(trial, model, STEPS)[first + 1 : first + STEPS + 1]
    np.testing.assert_allclose(found, expected, rtol=precision, atol=precision * 200.0)


def test_what_is_wanted_is_the_next_torque(pair):
    net, _, data, trial = pair
    x = sequence(net, data)
    net = net.double()
    logged, wanted = (part.movedim(2, 1)[:, 0] for part in (x[:, :-1, :, : net.joints], net.wanted(x, 0)))
    perfect = net.following(logged, wanted)[:, :, None]
    np.testing.assert_allclose(newton_metres(net, data, perfect), trial.effort[1:], rtol=1e-6, atol=1e-3)


def test_a_net_of_each_joint_sees_that_joint_alone(pair):
    net, _, data, _ = pair
    rows = torch.tensor(data.inputs[:50, None], dtype=torch.float32)
    changed = rows.clone()
    changed[..., 1::2] += 1.0  # all four signals of the second joint
    moved = net.for_joints(net.outputs(net.sequence(changed), 10) - net.outputs(net.sequence(rows), 10)).abs()
    assert (moved[..., 1] > 0.0).all()
    assert bool((moved[..., 0] == 0.0).all()) is net.per_joint


@pytest.mark.parametrize(("kind", "theirs"), [("lstm", torch.nn.LSTM), ("gru", torch.nn.GRU)])
def test_cells_are_those_of_torch(kind, theirs):
    trial = trajectory(samples=60)
    data = net_data(log_set(trial, trial).fit)
    net, cell = NETS[kind](data, 8), theirs(8, 8)
    with torch.no_grad():
        for name, value in net.matrices().items():
            kind_of, which = name.split("_")
            getattr(cell, f"{which}_{'ih' if kind_of == 'input' else 'hh'}_l0").copy_(value[0])
        rows = torch.tensor(data.inputs[:40, None], dtype=torch.float32)
        expected = cell(rows[:-1])[0] @ net.output.weight[0].T + net.output.bias[0]
        torch.testing.assert_close(net.for_joints(net.outputs(net.sequence(rows), 0)), expected, rtol=1e-5, atol=1e-6)
