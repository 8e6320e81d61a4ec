"""From an action to joint targets: prior plus scaled action, clipped to the joint limits."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.rl.gait import Trot, stepping
from hqpipe.rl.leg import constant


@dataclass(frozen=True)
class TargetRule:
    """q_des = clip(prior + action_scale · s · action), where s falls from 1 to `standing_scale` as the command goes to zero.

    Attributes:
        nominal: (J,) prior without a trot, rad. lower, upper: (J,) rad. action_scale: rad.
        standing_scale: factor on the action at zero command. standing_speed: m/s, from which on it is 1.
        trot: the prior of trot_residual, else None.
    """

    nominal: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    action_scale: float
    standing_scale: float
    standing_speed: float
    trot: Trot | None

    def unclipped(self, action: Any, clock: Any, command: Any, xp: ModuleType = np) -> Any:
        """(..., J) rad; `action` (..., J), `clock` (..., 2) or None, `command` (..., 3), all of the library `xp`."""
        if self.trot is None:
            prior = constant(self.nominal, action, xp)
        else:
            prior = self.trot.joint_targets(clock, command, xp)
        return prior + self._scale(command, xp) * action

    def _scale(self, command: Any, xp: ModuleType) -> Any:
        """Joint angle for an action of 1, rad: (..., 1), or a number where it does not depend on the command."""
        if self.standing_scale == 1.0:
            return self.action_scale
        share = stepping(command, self.standing_speed, xp)[..., None]
        return self.action_scale * (self.standing_scale + (1.0 - self.standing_scale) * share)

    def clipped(self, targets: Any, xp: ModuleType = np) -> Any:
        """Targets within the joint limits, rad."""
        return xp.clip(targets, constant(self.lower, targets, xp), constant(self.upper, targets, xp))
