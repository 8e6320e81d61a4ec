"""Phase clock and open-loop trot: joint targets from the phase and the velocity command.

The trot is the starting point that the policy corrects (prior ``trot_residual``), or only its clock is shown to the
policy (prior ``clock``), or neither (prior ``none``, the paper's observation).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from hqpipe.rl.config import GaitConfig
from hqpipe.rl.leg import LegGeometry, constant

# Trot: the diagonal pairs LF–RH and RF–LH swing in turn (Raibert 1986, Legged Robots That Balance, ch. 4).
# Share of the stance over which a foot takes up its load; assumption, short against the stance.
_LOAD_RAMP = 0.1
# Keeps the shares defined in the moment when no foot is scheduled to carry.
_LEAST_LOAD = 0.01
_OFFSET = {"LF": 0.0, "RF": 0.5, "LH": 0.5, "RH": 0.0}


def diagonal_feet(feet: tuple[str, ...]) -> np.ndarray:
    """(L,) number of the foot diagonally opposite of each, which swings with it in a trot."""
    offsets = leg_offsets(feet)
    return np.array(
        [next(k for k in range(len(feet)) if k != j and offsets[k] == offsets[j]) for j in range(len(feet))]
    )


def leg_offsets(feet: tuple[str, ...]) -> np.ndarray:
    """(L,) phase of each leg against the clock, in cycles."""
    return np.array([_OFFSET[foot] for foot in feet])


def advance(phase: np.ndarray, frequency_hz: float, dt: float) -> np.ndarray:
    """The clock one period later, in cycles within [0, 1)."""
    return (phase + frequency_hz * dt) % 1.0


def clock(phase: np.ndarray) -> np.ndarray:
    """(..., 2) sine and cosine of the phase (cycles)."""
    angle = 2.0 * np.pi * np.asarray(phase)
    return np.stack((np.sin(angle), np.cos(angle)), axis=-1)


def scheduled_stance(phase: np.ndarray, offsets: np.ndarray, duty: float) -> np.ndarray:
    """(..., L) bool: which feet the clock wants on the ground; `phase` (...) and `offsets` (L,) in cycles."""
    return (phase[..., None] + offsets) % 1.0 < duty


def stepping(command: Any, standing_speed: float, xp: ModuleType = np) -> Any:
    """(...,) share of a full step that `command` (..., 3) asks for: 0 when standing is commanded, 1 from `standing_speed` on.

    Args:
        command: vx, vy (m/s) and ω (rad/s) in the base frame; turning counts at a lever of 1 m.
        standing_speed: m/s.
    """
    speed = xp.sqrt((command * command).sum(-1) + 1e-12)
    return xp.clip(speed / standing_speed, 0.0, 1.0)


@dataclass(frozen=True)
class Trot:
    """Open-loop trot over flat ground.

    A stance foot moves back at the commanded velocity of its own hip, vx − ω y and vy + ω x; a swing foot returns
    along a cubic whose end velocities match the stance, lifted by H sin²(πu). Targets lead by `lead_s`, the lag of
    the position loop, and are ahead of the wanted angles by what the loop gives way under the share of the weight
    that the leg carries. Below `standing_speed` the steps shrink to nothing.

    Attributes:
        nominal_foot: (L, 3) feet of the nominal pose in the base frame, m.
        compliance: (L, 3) of the position loops, rad/(N·m). weight: of the robot, N.
    """

    config: GaitConfig
    geometry: LegGeometry
    offsets: np.ndarray
    nominal_foot: np.ndarray
    compliance: np.ndarray
    weight: float

    @classmethod
    def build(
        cls,
        config: GaitConfig,
        geometry: LegGeometry,
        feet: tuple[str, ...],
        nominal: np.ndarray,
        stiffness: np.ndarray,
        weight: float,
    ) -> Trot:
        """`nominal` (rad) and `stiffness` (N·m/rad) are (3 L,), leg by leg in the order of `feet`."""
        legs = (len(feet), 3)
        foot = geometry.forward(np.asarray(nominal, dtype=float).reshape(legs))
        compliance = 1.0 / np.asarray(stiffness, dtype=float).reshape(legs)
        return cls(config, geometry, leg_offsets(feet), foot, compliance, weight)

    def amplitude(self, command: Any, xp: ModuleType = np) -> Any:
        """(...,) share of a full step that `command` (..., 3) asks for, see `stepping`."""
        return stepping(command, self.config.standing_speed, xp)

    def joint_targets(self, clock_: Any, command: Any, xp: ModuleType = np) -> Any:
        """Targets of all joints, leg by leg.

        Args:
            clock_: (..., 2) sine and cosine of the phase.
            command: (..., 3) vx, vy (m/s) and ω (rad/s) in the base frame.

        Returns:
            (..., 3 L) rad, in the type of `command`.
        """
        phase = self._leg_phase(clock_, command, xp)
        legs = self.geometry.inverse(self.foot_targets(phase, command, xp), xp)
        load = self.weight * self.load_share(phase, command, xp)[..., None]
        legs = legs + load * constant(self.compliance, command, xp) * self.geometry.support(legs, xp)
        return legs.reshape(*legs.shape[:-2], 3 * legs.shape[-2])

    def _leg_phase(self, clock_: Any, command: Any, xp: ModuleType) -> Any:
        """(..., L) phase of each leg in cycles within [0, 1), stance first, ahead by the lead."""
        c = self.config
        phase = xp.atan2(clock_[..., 0:1], clock_[..., 1:2]) / (2.0 * np.pi)
        phase = phase + constant(self.offsets + c.lead_s * c.frequency_hz, command, xp)
        return phase - xp.floor(phase)

    def foot_targets(self, phase: Any, command: Any, xp: ModuleType = np) -> Any:
        """Foot centres in the base frame: (..., L) leg phase, (..., 3) command → (..., L, 3) m."""
        c = self.config
        place = constant(self.nominal_foot, command, xp)
        velocity_x = command[..., 0:1] - command[..., 2:3] * place[..., 1]
        velocity_y = command[..., 1:2] + command[..., 2:3] * place[..., 0]
        period = 1.0 / c.frequency_hz
        swing = xp.clip((phase - c.duty) / (1.0 - c.duty), 0.0, 1.0)
        travel = c.duty * period * _return_stroke(swing, (1.0 - c.duty) / c.duty)
        stance = c.duty * period * (0.5 - phase / c.duty)
        along = xp.where(phase < c.duty, stance, travel)
        lift = self.amplitude(command, xp)[..., None] * c.swing_height * xp.sin(np.pi * swing) ** 2
        return xp.stack((along * velocity_x, along * velocity_y, lift), -1) + place

    def load_share(self, phase: Any, command: Any, xp: ModuleType = np) -> Any:
        """(..., L) share of the weight on each leg, summing to 1: equal when standing, else on the stance legs."""
        c = self.config
        stance = phase / c.duty
        carried = xp.clip(xp.minimum(stance, 1.0 - stance) / _LOAD_RAMP, 0.0, 1.0) + _LEAST_LOAD
        walking = carried / carried.sum(-1)[..., None]
        amplitude = self.amplitude(command, xp)[..., None]
        return amplitude * walking + (1.0 - amplitude) / phase.shape[-1]


def _return_stroke(u: Any, ratio: float) -> Any:
    """Cubic from −½ to +½ over u ∈ [0, 1] whose slope at both ends is −ratio, the speed of the stance."""
    blend = u * u * (3.0 - 2.0 * u)
    return blend - 0.5 - ratio * (u * (1.0 - u) * (1.0 - 2.0 * u))
