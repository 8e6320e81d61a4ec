"""Commands that go from one posture to another, at once or within a moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hqpipe.errors import UsageError, near_match
from hqpipe.robots import RobotSpec

KINDS = ("jumps", "collapse")
STAND_SHARE = 0.2  # of the trial before the first jump
JUMPS = (
    0.15,
    0.0,
    -0.12,
    0.02,
)  # rad of hip pitch from the nominal pose; the knee jumps by twice their steps: 0.24 to 0.3
FOLDED = (1.6, -2.1)  # rad, hip pitch and knee of a leg that gives way, near the ends of their travel
FOLD_TIME = 0.4  # s in which it does, about that of a free fall from standing height; assumption


@dataclass(frozen=True)
class Postures:
    """A controller: postures (P, J) rad, each taken up from its start time (P,) s on within `blend` s, and held."""

    starts: np.ndarray
    poses: np.ndarray
    blend: float = 0.0

    def __call__(self, frame: Any, command: dict[str, float] | None = None) -> np.ndarray:
        """(J,) joint targets, rad, at `frame.time`."""
        now = max(int(np.searchsorted(self.starts, frame.time, side="right")) - 1, 0)
        since = frame.time - self.starts[now]
        if now == 0 or since >= self.blend:
            return self.poses[now]
        return self.poses[now - 1] + since / self.blend * (self.poses[now] - self.poses[now - 1])


def postures(robot: RobotSpec, kind: str, duration: float) -> Postures:
    """Stand, then jump or collapse.

    Args:
        robot: nominal pose and joint names, which end in R, P and K for hip roll, hip pitch and knee.
        kind: "jumps" (crouch and rise by turns, `JUMPS` about the nominal pose, evenly spaced, at once) or "collapse" (the
            legs of the left side fold under the robot within `FOLD_TIME`).
        duration: s.

    Raises:
        UsageError: unknown kind.
    """
    if kind not in KINDS:
        raise UsageError(f"postures: expected one of {', '.join(KINDS)}, got '{kind}'{near_match(kind, KINDS)}")
    stand = robot.nominal_position
    if kind == "collapse":
        left = [name for name in robot.joints if name.startswith("L")]
        poses = [_moved(robot, left, FOLDED, absolute=True)]
    else:
        poses = [_moved(robot, robot.joints, (size, -2.0 * size)) for size in JUMPS]
    starts = duration * (STAND_SHARE + (1.0 - STAND_SHARE) * np.arange(len(poses)) / len(poses))
    blend = FOLD_TIME if kind == "collapse" else 0.0
    return Postures(np.concatenate([[0.0], starts]), np.stack([stand, *poses]), blend)


def _moved(
    robot: RobotSpec, joints: Sequence[str], pitch_knee: tuple[float, float], absolute: bool = False
) -> np.ndarray:
    """(J,) rad, the nominal pose with hip pitch and knee of some legs moved by, or to, two angles."""
    pose = robot.nominal_position.copy()
    for suffix, angle in zip(("P", "K"), pitch_knee, strict=True):
        rows = [robot.joints.index(name) for name in joints if name.endswith(suffix)]
        pose[rows] = angle if absolute else pose[rows] + angle
    return np.clip(pose, robot.position_lower, robot.position_upper)
