"""What acts on the machine from outside during a trial: blows on the trunk, and a grip on the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

PUSH_TIME = 0.15  # s; assumption: a shove or a swinging weight acts for one to two tenths of a second
GRIP_FADE = 0.1  # s to take hold and to let go; assumption


@dataclass(frozen=True)
class Outside:
    """What acts during one firmware tick.

    Attributes:
        force: (3,) N on the trunk's centre of mass, world frame.
        torque: (J,) N·m on the joints.
    """

    force: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True)
class Push:
    """A blow on the trunk; its force rises and falls as half a sine wave.

    Attributes:
        start: s into the trial.
        impulse: N·s forwards, to the left and upwards, in the heading of the trunk.
        duration: s.
    """

    start: float
    impulse: tuple[float, float, float]
    duration: float = PUSH_TIME

    def force(self, time: float, heading: float) -> np.ndarray:
        """(3,) N in the world frame at `time` s for a trunk that heads `heading` rad to the left of world x."""
        share = (time - self.start) / self.duration
        if not 0.0 <= share < 1.0:
            return np.zeros(3)
        forward, left, up = self.impulse
        cos, sin = np.cos(heading), np.sin(heading)
        world = np.array([cos * forward - sin * left, sin * forward + cos * left, up])
        return world * (0.5 * np.pi / self.duration * np.sin(np.pi * share))


@dataclass(frozen=True)
class Grip:
    """Something beside the actuators that holds every joint by a spring and takes it to the commanded angle, or away.

    A joint that is dragged to its command faster than the valve feeds the cylinder has a torque against the command: the
    actuator brakes. A joint that is forced away is loaded up to what the grip can give.

    Attributes:
        start: s into the trial. duration: s.
        stiffness: N·m/rad; negative forces the joints away from their commands.
        limit: N·m.
    """

    start: float
    duration: float
    stiffness: float
    limit: float

    def torque(self, time: float, error: np.ndarray) -> np.ndarray:
        """(J,) N·m at `time` s for joints that are `error` (J,) rad behind their commands."""
        inside = min(time - self.start, self.start + self.duration - time)
        share = min(max(inside / GRIP_FADE, 0.0), 1.0)
        return share * np.clip(self.stiffness * error, -self.limit, self.limit)


Disturbance = Push | Grip


def acting(disturbances: Sequence[Disturbance], time: float, error: np.ndarray, heading: float) -> Outside:
    """The sum of all disturbances at `time` s; `error` (J,) rad and `heading` rad as in `Grip` and `Push`."""
    force, torque = np.zeros(3), np.zeros(len(error))
    for disturbance in disturbances:
        if isinstance(disturbance, Push):
            force += disturbance.force(time, heading)
        else:
            torque += disturbance.torque(time, error)
    return Outside(force, torque)
