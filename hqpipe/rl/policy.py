"""The networks as a policy of Stable-Baselines3."""

from __future__ import annotations

from typing import Any

import gymnasium
import torch
from stable_baselines3.common.distributions import DiagGaussianDistribution, Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor, nn

from hqpipe.rl.networks import LocomotionNetworks
from hqpipe.rl.policy_spec import PolicySpec


class LocomotionPolicy(ActorCriticPolicy):
    """Gaussian policy over observations that hold o_t and x_t side by side.

    Args:
        spec: layouts and sizes.
        initial_log_std: of every action. output_gain: factor on the last layers' initial weights.
        critic_learning_rate, estimator_learning_rate: fixed; the actor's follows the KL divergence.
    """

    def __init__(
        self,
        observation_space: gymnasium.spaces.Box,
        action_space: gymnasium.spaces.Box,
        lr_schedule: Any,
        *,
        spec: PolicySpec,
        initial_log_std: float,
        output_gain: float,
        critic_learning_rate: float,
        estimator_learning_rate: float,
        **_: Any,
    ) -> None:
        self.spec = spec
        self._initial = (initial_log_std, output_gain)
        self._rates = (critic_learning_rate, estimator_learning_rate)
        super().__init__(observation_space, action_space, lr_schedule, ortho_init=False)

    def _build(self, lr_schedule: Any) -> None:
        initial_log_std, output_gain = self._initial
        self.networks = LocomotionNetworks(self.spec, output_gain)
        self.log_std = nn.Parameter(torch.full((len(self.spec.joints),), float(initial_log_std)))
        self.action_dist = DiagGaussianDistribution(len(self.spec.joints))
        critic_rate, estimator_rate = self._rates
        networks = self.networks
        self.optimizer = torch.optim.Adam(self.actor_parameters(), lr=lr_schedule(1), eps=1e-5)
        self.critic_optimizer = torch.optim.Adam(networks.critic.parameters(), lr=critic_rate)
        self.estimator_optimizer = torch.optim.Adam(networks.estimator.parameters(), lr=estimator_rate)

    def actor_parameters(self) -> list[nn.Parameter]:
        """What PPO's surrogate trains."""
        return [*self.networks.actor.parameters(), self.log_std]

    def limit_exploration(self, log_std: float) -> None:
        """Narrow the Gaussian to at most `log_std` in every action."""
        with torch.no_grad():
            self.log_std.clamp_(max=log_std)

    def split(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """o_t and x_t."""
        size = self.spec.observation.size
        return obs[:, :size], obs[:, size:]

    def get_distribution(self, obs: Tensor, estimate: Tensor | None = None) -> Distribution:
        """Gaussian of the action; with `estimate` given, for that x̃_t instead of the estimator's present one."""
        mean = self.networks.action(self.split(obs)[0], estimate)
        return self.action_dist.proba_distribution(mean, self.log_std)

    def predict_values(self, obs: Tensor) -> Tensor:
        return self.networks.value(*self.split(obs))

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        distribution = self.get_distribution(obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self.predict_values(obs), distribution.log_prob(actions)

    def evaluate_actions(self, obs: Tensor, actions: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        distribution = self.get_distribution(obs)
        return self.predict_values(obs), distribution.log_prob(actions), distribution.entropy()

    def _predict(self, observation: Tensor, deterministic: bool = False) -> Tensor:
        return self.get_distribution(observation).get_actions(deterministic=deterministic)
