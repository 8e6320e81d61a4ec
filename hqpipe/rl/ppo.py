"""PPO of Stable-Baselines3 with a KL-adaptive learning rate and the concurrently trained estimator."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import PPO
from torch import Tensor, nn

from hqpipe.errors import DivergedError
from hqpipe.rl.config import PPOConfig
from hqpipe.rl.policy import LocomotionPolicy

# Schedule of Rudin et al. 2022 (Learning to Walk in Minutes): factor 1.5 outside of [target / 2, 2 target].
_FACTOR, _LOWEST, _HIGHEST = 1.5, 1e-5, 2e-3
_LOG_RATIO_LIMIT = 20.0  # keeps exp finite in float32 when a sample has become impossible


class ConcurrentPPO(PPO):
    """PPO whose gradient steps also train the estimator on the rollout (Ji et al. 2022).

    Args:
        kl_target: where the learning rate is held.
    """

    policy: LocomotionPolicy

    def __init__(self, *args: Any, config: PPOConfig, **kwargs: Any) -> None:
        self.config = config
        self.adaptive_learning_rate = config.learning_rate
        super().__init__(
            *args,
            n_steps=config.n_steps,
            batch_size=config.batch_size,
            n_epochs=config.n_epochs,
            learning_rate=config.learning_rate,
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            clip_range=config.clip_range,
            ent_coef=config.ent_coef,
            max_grad_norm=config.max_grad_norm,
            device="cpu",
            **kwargs,
        )

    def train(self) -> None:
        """Update actor, critic and estimator with the rollout in the buffer."""
        self.policy.set_training_mode(True)
        data = self._flat_buffer()
        size, batch = len(data["advantages"]), self.config.batch_size
        passes = min(self.config.estimator_epochs, self.config.n_epochs)
        sums: dict[str, float] = {}
        for epoch in range(self.config.n_epochs):
            order = torch.randperm(size)
            for start in range(0, size, batch):
                rows = {key: value[order[start : start + batch]] for key, value in data.items()}
                for key, value in self._gradient_step(rows).items():
                    sums[key] = sums.get(key, 0.0) + value / self.config.n_epochs
                if epoch < passes:
                    loss = self._estimator_step(rows)
                    sums["estimator_loss"] = sums.get("estimator_loss", 0.0) + loss / passes
        self._n_updates += self.config.n_epochs
        for key, value in sums.items():
            self.logger.record(f"train/{key}", value / (size // batch))
        values, returns = data["values"], data["returns"]
        unexplained = (returns - values).var() / returns.var().clamp_min(1e-12)
        self.logger.record("train/explained_variance", float(1.0 - unexplained))
        self.logger.record("train/learning_rate", self.adaptive_learning_rate)
        self.logger.record("train/std", self.policy.log_std.exp().mean().item())
        self.logger.record("train/n_updates", self._n_updates)

    def _flat_buffer(self) -> dict[str, Tensor]:
        """The rollout with time and environments joined; advantages normalised over all of it.

        The estimates are those the actions were drawn with: the estimator moves during the update, and its motion
        must not pass for a change of the policy.
        """
        buffer = self.rollout_buffer
        names = ("observations", "actions", "log_probs", "values", "returns", "advantages")
        data = {name: torch.as_tensor(buffer.swap_and_flatten(getattr(buffer, name))) for name in names}
        for name in ("log_probs", "values", "returns", "advantages"):
            data[name] = data[name].flatten()
        data["estimates"] = self.policy.networks.estimate(self.policy.split(data["observations"])[0])
        advantages = data["advantages"]
        data["advantages"] = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        return data

    def _gradient_step(self, rows: dict[str, Tensor]) -> dict[str, float]:
        c, policy = self.config, self.policy
        observations = rows["observations"]
        distribution = policy.get_distribution(observations, rows["estimates"])
        entropy, values = distribution.entropy(), policy.predict_values(observations)
        log_ratio = (distribution.log_prob(rows["actions"]) - rows["log_probs"]).clamp(
            -_LOG_RATIO_LIMIT, _LOG_RATIO_LIMIT
        )
        ratio = log_ratio.exp()
        with torch.no_grad():
            # http://joschu.net/blog/kl-approx.html, estimator k3
            divergence = float((ratio - 1.0 - log_ratio).mean())
        self._adapt_learning_rate(divergence)
        clipped = ratio.clamp(1.0 - c.clip_range, 1.0 + c.clip_range)
        surrogate = -torch.min(ratio * rows["advantages"], clipped * rows["advantages"]).mean()
        surrogate = surrogate - c.ent_coef * entropy.mean()
        value_loss = nn.functional.mse_loss(values.flatten(), rows["returns"])
        self._descend(policy.critic_optimizer, value_loss)
        if self._n_updates >= c.critic_warmup * c.n_epochs:
            self._descend(policy.optimizer, surrogate)
        outside = (ratio - 1.0).abs() > c.clip_range
        return {
            "approx_kl": divergence,
            "clip_fraction": float(outside.float().mean()),
            "policy_gradient_loss": surrogate.item(),
            "value_loss": value_loss.item(),
            "entropy_loss": -entropy.mean().item(),
        }

    def _estimator_step(self, rows: dict[str, Tensor]) -> float:
        loss = self.policy.networks.estimator_loss(*self.policy.split(rows["observations"]))
        self._descend(self.policy.estimator_optimizer, loss)
        return loss.item()

    def _descend(self, optimizer: torch.optim.Optimizer, loss: Tensor) -> None:
        optimizer.zero_grad()
        loss.backward()
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        norm = nn.utils.clip_grad_norm_(parameters, self.config.max_grad_norm)
        if not torch.isfinite(norm):  # before it is in the weights, where the next distribution would fail on it
            raise DivergedError("the training diverged: a gradient is not finite; lower ppo.learning_rate")
        optimizer.step()

    def _adapt_learning_rate(self, divergence: float) -> None:
        rate, target = self.adaptive_learning_rate, self.config.target_kl
        if divergence > 2.0 * target:
            rate = max(_LOWEST, rate / _FACTOR)
        elif 0.0 < divergence < 0.5 * target:
            rate = min(_HIGHEST, rate * _FACTOR)
        self.adaptive_learning_rate = rate
        for group in self.policy.optimizer.param_groups:
            group["lr"] = rate
