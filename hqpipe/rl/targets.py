"""From an action to joint targets: prior plus scaled action, clipped to the joint limits."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.rl.gait import Trot
from hqpipe.rl.leg import constant


@dataclass(frozen=True)
class TargetRule:
    """q_des = clip(prior + action_scale · action).

    Attributes:
        nominal: (J,) prior without a trot, rad. lower, upper: (J,) rad. action_scale: rad.
        trot: the prior of trot_residual, else None.
    """

    nominal: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    action_scale: float
    trot: Trot | None

    def unclipped(self, action: Any, clock: Any, command: Any, xp: ModuleType = np) -> Any:
        """(..., J) rad; `action` (..., J), `clock` (..., 2) or None, `command` (..., 3), all of the library `xp`."""
        if self.trot is None:
            prior = constant(self.nominal, action, xp)
        else:
            prior = self.trot.joint_targets(clock, command, xp)
        return prior + self.action_scale * action

    def clipped(self, targets: Any, xp: ModuleType = np) -> Any:
        """Targets within the joint limits, rad."""
        return xp.clip(targets, constant(self.lower, targets, xp), constant(self.upper, targets, xp))
