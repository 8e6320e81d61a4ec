"""How the machine moves in a case: gantry multisines, and open-loop trots that need no policy."""

from __future__ import annotations

from typing import Any

import numpy as np

from hqpipe.robots import RobotSpec

THIGH = SHANK = 0.45  # m, robot.urdf
GAIT_HZ = (1.5, 1.9)  # Hz, drawn per trial; within these the open-loop trot stays upright and steps softly
STRIDE = (0.18, 0.24)  # m, likewise
LIFT = (0.11, 0.14)  # m, likewise
SWAY = (0.03, 0.04)  # rad at the roll joints, likewise: without it they would only hold the load
SWAY_HZ = (1.0, 1.4)  # Hz, likewise: below the gait, so that load and command are told apart
_BLEND_TIME = 1.0  # s to the full stride
_DIAGONAL = {"LF": 0.0, "RH": 0.0, "RF": 0.5, "LH": 0.5}  # phase of a trot


class Trot:
    """A controller: feet sweep back on a line for half of the period and swing forward on a half sine.

    Args:
        robot: nominal pose and legs. seed: of gait frequency, stride, lift and the phase at the start.
    """

    def __init__(self, robot: RobotSpec, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._robot = robot
        self.gait_hz, self.stride, self.lift = (float(rng.uniform(*span)) for span in (GAIT_HZ, STRIDE, LIFT))
        self.sway, self.sway_hz = float(rng.uniform(*SWAY)), float(rng.uniform(*SWAY_HZ))
        self._start = 0.5 * float(rng.integers(2))  # either diagonal steps first
        _, pitch, knee = robot.nominal_position[:3]
        self._foot_x = -THIGH * np.sin(pitch) - SHANK * np.sin(pitch + knee)
        self._foot_z = -THIGH * np.cos(pitch) - SHANK * np.cos(pitch + knee)

    def __call__(self, frame: Any, command: dict[str, float] | None = None) -> np.ndarray:
        """(12,) joint targets, rad, at `frame.time`."""
        target, blend = self._robot.nominal_position.copy(), min(frame.time / _BLEND_TIME, 1.0)
        for number, leg in enumerate(self._robot.feet):
            phase = (frame.time * self.gait_hz + _DIAGONAL[leg] + self._start) % 1.0
            swing = max(2.0 * phase - 1.0, 0.0)
            x = self.stride * (0.5 - 2.0 * phase) if phase < 0.5 else -0.5 * self.stride * np.cos(np.pi * swing)
            z = 0.5 * self.lift * (1.0 - np.cos(2.0 * np.pi * swing))
            target[3 * number] += blend * self.sway * np.sin(2.0 * np.pi * self.sway_hz * frame.time)
            target[3 * number + 1 : 3 * number + 3] = joint_angles(self._foot_x + blend * x, self._foot_z + blend * z)
        return target


def joint_angles(x: float, z: float) -> tuple[float, float]:
    """Pitch and knee, rad, that put the foot at x, z m from the hip; law of cosines, knee bent backwards."""
    cosine = (x * x + z * z - THIGH**2 - SHANK**2) / (2.0 * THIGH * SHANK)
    knee = -np.arccos(np.clip(cosine, -1.0, 1.0))
    lean = np.arctan2(SHANK * np.sin(knee), THIGH + SHANK * np.cos(knee))
    return float(np.arctan2(-x, -z) - lean), float(knee)
