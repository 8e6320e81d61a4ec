"""How long each foot has been in the air or on the ground."""

from __future__ import annotations

import numpy as np


class ContactTimer:
    """Counts the running phase of each foot; the other phase's time is zero.

    Attributes:
        air, stance: (N, L) s.
    """

    def __init__(self, count: int, feet: int) -> None:
        self.air = np.zeros((count, feet))
        self.stance = np.zeros((count, feet))

    def reset(self, indices: np.ndarray) -> None:
        self.air[indices] = 0.0
        self.stance[indices] = 0.0

    def advance(self, contact: np.ndarray, dt: float) -> None:
        """`contact`: (N, L) bool at the end of a period of `dt` s."""
        self.stance = np.where(contact, self.stance + dt, 0.0)
        self.air = np.where(contact, 0.0, self.air + dt)
