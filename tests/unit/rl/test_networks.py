from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from hqpipe.rl import gait
from hqpipe.rl.networks import DeployedPolicy, LocomotionNetworks
from hqpipe.rl.observation import build_observation


@pytest.fixture
def networks(spec) -> LocomotionNetworks:
    torch.manual_seed(0)
    return LocomotionNetworks(spec)


def observations(spec, count: int = 6) -> torch.Tensor:
    return torch.randn(count, spec.observation.size, generator=torch.Generator().manual_seed(1))


def test_the_policy_s_gradient_does_not_reach_the_estimator(spec, networks):
    networks.action(observations(spec)).sum().backward()
    assert all(p.grad is None for p in networks.estimator.parameters())
    assert all(p.grad is not None for p in networks.actor.parameters())


@pytest.mark.parametrize("leg_odometry", [False, True])
def test_the_estimator_learns_from_the_state_alone(spec, leg_odometry):
    networks = LocomotionNetworks(replace(spec, leg_odometry=leg_odometry))
    networks.estimator_loss(observations(spec), torch.zeros(6, spec.state.size)).backward()
    assert all(p.grad is not None for p in networks.estimator.parameters())
    assert all(p.grad is None for p in networks.actor.parameters())


def test_actor_sees_the_estimate_and_critic_the_truth(spec, networks):
    seen, state = observations(spec), torch.zeros(6, spec.state.size)
    other = torch.ones(6, spec.state.size)
    assert not torch.equal(networks.value(seen, state), networks.value(seen, other))
    assert not torch.equal(networks.action(seen, state), networks.action(seen, other))
    assert torch.equal(networks.action(seen), networks.action(seen, networks.estimate(seen)))


def test_output_gain_scales_the_first_action(spec):
    torch.manual_seed(0)
    full = LocomotionNetworks(spec, 1.0)
    torch.manual_seed(0)
    tenth = LocomotionNetworks(spec, 0.1)
    seen, estimate = observations(spec), torch.zeros(6, spec.state.size)
    torch.testing.assert_close(tenth.action(seen, estimate), 0.1 * full.action(seen, estimate))


@pytest.mark.parametrize("standing_scale", [1.0, 0.2])
def test_deployed_graph_equals_the_environment_s_rule(spec, networks, standing_scale):
    spec = replace(spec, standing_scale=standing_scale)
    rng = np.random.default_rng(0)
    command, phase = rng.uniform(-0.4, 1.0, (20, 3)), rng.random(20)
    command[:5], command[5:10] = 0.0, 0.1 * command[5:10]
    joints = [rng.normal(0.0, 0.5, (20, 12)) for _ in range(3)]
    seen = build_observation(rng.normal(size=(20, 3)), *joints, command, gait.clock(phase))
    with torch.no_grad():
        action = networks.action(torch.as_tensor(seen)).numpy()
        deployed = DeployedPolicy(spec, networks)(torch.as_tensor(seen))[0].numpy()
    rule = spec.target_rule()
    expected = rule.clipped(rule.unclipped(action.astype(float), gait.clock(phase), command))
    np.testing.assert_allclose(deployed, expected, atol=1e-4)
    assert (deployed <= spec.upper + 1e-6).all() and (deployed >= spec.lower - 1e-6).all()
