"""An estimator that takes the linear velocity from the legs: which legs stand is learned, their kinematics is given."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hqpipe.rl.leg_odometry import trunk_velocities
from hqpipe.rl.limits import FASTEST
from hqpipe.rl.normaliser import Normaliser
from hqpipe.rl.policy_spec import PolicySpec


class OdometryEstimator(nn.Module):
    """x̃_t whose linear velocity is the weighted mean of what the legs give, plus a correction.

    With vᵢ the velocity of the trunk as leg i gives it (`hqpipe.rl.leg_odometry`) and logits s and correction c from a
    network that sees o_t and all vᵢ, ṽ = Σ softmax(s)ᵢ vᵢ + c. The other elements of x̃_t are the network's own. All of it
    is computed from o_t, so the robot sends nothing more and the graph keeps no state.

    Args:
        spec: layouts and geometry.
        network: (B, n + 3 L) normalised o_t and vᵢ → (B, m + L) normalised x̃_t with c in the place of ṽ, and s.
    """

    def __init__(self, spec: PolicySpec, network: nn.Module) -> None:
        super().__init__()
        layout = spec.observation
        self.network, self.geometry, self.state_size = network, spec.geometry, spec.state.size
        self.turning = layout.part("base_angular_velocity")
        self.position, self.rate = layout.part("joint_position"), layout.part("joint_velocity")
        self.velocity = spec.state.part("base_linear_velocity")
        self.normalise = Normaliser(layout)
        scale = torch.as_tensor(spec.state.scale[self.velocity])
        self.register_buffer("velocity_scale", scale, persistent=False)

    def forward(self, observation: Tensor) -> Tensor:
        """(B, n) → (B, m), both normalised."""
        legs = self.leg_velocities(observation)
        answer = self.network(torch.cat((observation, legs.flatten(-2)), dim=-1))
        stance = torch.softmax(answer[:, self.state_size :], dim=-1)
        mean = (stance[..., None] * legs).sum(dim=-2)
        first, last = self.velocity.start, self.velocity.stop
        before, after = answer[:, :first], answer[:, last : self.state_size]
        return torch.cat((before, answer[:, first:last] + mean, after), dim=-1)

    def leg_velocities(self, observation: Tensor) -> Tensor:
        """(B, n) normalised → (B, L, 3) velocity of the trunk by each leg, normalised as in x_t.

        Bounded by the fastest command that there may be, so that a leg that is torn about in a fall does not outweigh a batch.
        """
        seen = self.normalise.restore(observation)
        joints, rates = (seen[:, part].unflatten(-1, (-1, 3)) for part in (self.position, self.rate))
        velocity = trunk_velocities(self.geometry, seen[:, self.turning], joints, rates, torch)
        return velocity.clamp(-FASTEST, FASTEST) * self.velocity_scale
