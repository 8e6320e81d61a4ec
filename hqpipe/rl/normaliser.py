"""Physical units to numbers of order one and back, inside the networks."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hqpipe.rl.observation import Layout


class Normaliser(nn.Module):
    """(value − offset) · scale with the fixed physical constants of a layout."""

    def __init__(self, layout: Layout) -> None:
        super().__init__()
        self.register_buffer("offset", torch.as_tensor(layout.offset), persistent=False)
        self.register_buffer("scale", torch.as_tensor(layout.scale), persistent=False)

    def forward(self, value: Tensor) -> Tensor:
        return (value - self.offset) * self.scale

    def restore(self, value: Tensor) -> Tensor:
        """Inverse of `forward`: physical units."""
        return value / self.scale + self.offset
