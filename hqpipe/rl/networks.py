"""Actor, critic and estimator, and the deployed graph from observation to joint targets."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hqpipe.rl.mirror import Mirror, mirror_joints, mirror_layout
from hqpipe.rl.normaliser import Normaliser
from hqpipe.rl.odometry_estimator import OdometryEstimator
from hqpipe.rl.policy_spec import PolicySpec


def mlp(inputs: int, hidden: tuple[int, ...], outputs: int) -> nn.Sequential:
    """Linear layers with ELU between them; orthogonal weights of gain √2, zero biases."""
    layers: list[nn.Module] = []
    sizes = (inputs, *hidden, outputs)
    for fan_in, fan_out in zip(sizes[:-1], sizes[1:], strict=True):
        linear = nn.Linear(fan_in, fan_out)
        nn.init.orthogonal_(linear.weight, 2.0**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, nn.ELU()]
    return nn.Sequential(*layers[:-1])


class Symmetric(nn.Module):
    """A network whose output for the mirror image of an input is the mirror image of its output: the mean of both ways.

    Args:
        network: (B, n) → (B, m). seen, given: of its input and output.
    """

    def __init__(self, network: nn.Module, seen: Mirror, given: Mirror) -> None:
        super().__init__()
        self.network = network
        for name, mirror in (("seen", seen), ("given", given)):
            self.register_buffer(f"{name}_order", torch.as_tensor(mirror.order), persistent=False)
            self.register_buffer(f"{name}_sign", torch.as_tensor(mirror.sign), persistent=False)

    def forward(self, value: Tensor) -> Tensor:
        other = self.network(value[:, self.seen_order] * self.seen_sign)
        return 0.5 * (self.network(value) + other[:, self.given_order] * self.given_sign)


class LocomotionNetworks(nn.Module):
    """The paper's three networks (its figure of the concurrent training framework).

    The estimator maps o_t to x̃_t, the actor (o_t, x̃_t) to the action, the critic (o_t, x_t) to the value. No
    gradient of the policy reaches the estimator: it learns from x_t alone (Ji et al. 2022). With `leg_odometry` of the
    spec it is an `OdometryEstimator`, which is not the paper's.
    """

    def __init__(self, spec: PolicySpec, output_gain: float = 1.0) -> None:
        super().__init__()
        seen, state = spec.observation.size, spec.state.size
        self.normalise_observation = Normaliser(spec.observation)
        self.normalise_state = Normaliser(spec.state)
        legs = len(spec.feet) if spec.leg_odometry else 0
        self.estimator = mlp(seen + 3 * legs, spec.hidden, state + legs)
        self.actor = mlp(seen + state, spec.hidden, len(spec.joints))
        self.critic = mlp(seen + state, spec.hidden, 1)
        with torch.no_grad():
            for network in (self.estimator, self.actor, self.critic):
                network[-1].weight.mul_(output_gain)
        if spec.leg_odometry:
            self.estimator = OdometryEstimator(spec, self.estimator)
        if spec.symmetric:
            image = mirror_layout(spec.observation, spec.feet)
            believed = mirror_layout(spec.state, spec.feet)
            self.estimator = Symmetric(self.estimator, image, believed)
            self.actor = Symmetric(self.actor, image.beside(believed), mirror_joints(spec.feet))

    def estimate(self, observation: Tensor) -> Tensor:
        """(B, n) o_t in physical units → (B, m) x̃_t, normalised; carries no gradient."""
        with torch.no_grad():
            return self.estimator(self.normalise_observation(observation))

    def action(self, observation: Tensor, estimate: Tensor | None = None) -> Tensor:
        """(B, n) o_t in physical units → (B, J) mean action; `estimate` replaces the estimator's present x̃_t."""
        if estimate is None:
            estimate = self.estimate(observation)
        return self.actor(torch.cat((self.normalise_observation(observation), estimate), dim=-1))

    def value(self, observation: Tensor, state: Tensor) -> Tensor:
        """(B, n) o_t and (B, m) x_t in physical units → (B, 1)."""
        seen, known = self.normalise_observation(observation), self.normalise_state(state)
        return self.critic(torch.cat((seen, known), dim=-1))

    def estimator_loss(self, observation: Tensor, state: Tensor) -> Tensor:
        """Mean squared error of x̃_t in normalised units."""
        estimate = self.estimator(self.normalise_observation(observation))
        return nn.functional.mse_loss(estimate, self.normalise_state(state))


class DeployedPolicy(nn.Module):
    """One graph from o_t to joint targets and to x̃_t: normalisation, estimator, actor, prior and joint limits."""

    def __init__(self, spec: PolicySpec, networks: LocomotionNetworks) -> None:
        super().__init__()
        self.spec, self.networks = spec, networks
        self.rule = spec.target_rule()

    def forward(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """(B, n) → (B, J) joint position targets, rad, within the joint limits, and (B, m) x̃_t in physical units."""
        estimate = self.networks.estimate(obs)
        action = self.networks.action(obs, estimate)
        layout = self.spec.observation
        clock = obs[:, layout.part("clock")] if self.spec.has_clock else None
        command = obs[:, layout.part("velocity_command")]
        targets = self.rule.clipped(self.rule.unclipped(action, clock, command, torch), torch)
        return targets, self.networks.normalise_state.restore(estimate)
