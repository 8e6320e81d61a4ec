"""How walks under one order differ: nobody sets a machine down twice in the same way, or holds a stick quite still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hqpipe.robots import RobotSpec

# All sizes are assumptions: what a careful operator cannot help, well below what would make it another test.
POSTURE = 0.03  # rad, at most, by which each joint stands beside its nominal angle: a foot lies 1 to 2 cm elsewhere
COURSE = 0.1  # rad, at most, by which the trunk is turned off its course
WAIT, RAMP = (0.2, 0.7), (0.3, 0.7)  # s of standing, and of pushing the stick to the ordered speed: within the 2 s that
# every judgement of a walk leaves out
WAVER = 0.03  # m/s, amplitude forwards and sideways of a hand that holds the stick
WAVER_HZ = (0.15, 0.45)
_STREAM = 7  # keeps these numbers apart from the plant's noise, which has the same seed


@dataclass(frozen=True)
class Repeat:
    """One of several walks under the same order.

    Attributes:
        posture: (J,) rad at which the robot is set down.
        heading: rad to the left of the course.
        phase: of the gait's clock at the start, in cycles.
        wait, ramp: s until the speed is ordered, and until it is reached.
        waver_hz, waver_phase: (2,) Hz and rad, forwards and sideways.
    """

    posture: np.ndarray
    heading: float
    phase: float
    wait: float
    ramp: float
    waver_hz: np.ndarray
    waver_phase: np.ndarray

    def command(self, vx: float, vy: float, wz: float) -> Callable[[float], dict[str, float]]:
        """What is ordered at `time` s of a walk that is to go at vx, vy (m/s) and wz (rad/s).

        Nobody's hand is on the stick of a robot that is to stand.
        """
        waver = WAVER if vx or vy or wz else 0.0

        def at(time: float) -> dict[str, float]:
            share = min(max((time - self.wait) / self.ramp, 0.0), 1.0)
            hand = waver * np.sin(2.0 * np.pi * self.waver_hz * time + self.waver_phase)
            return {"vx": share * (vx + hand[0]), "vy": share * (vy + hand[1]), "wz": share * wz}

        return at


def repeat(robot: RobotSpec, seed: int) -> Repeat:
    """The walk that belongs to `seed`."""
    rng = np.random.default_rng((seed, _STREAM))
    posture = robot.nominal_position + rng.uniform(-POSTURE, POSTURE, len(robot.joints))
    return Repeat(
        posture=np.clip(posture, robot.position_lower, robot.position_upper),
        heading=float(rng.uniform(-COURSE, COURSE)),
        phase=float(rng.uniform(0.0, 1.0)),
        wait=float(rng.uniform(*WAIT)),
        ramp=float(rng.uniform(*RAMP)),
        waver_hz=rng.uniform(*WAVER_HZ, 2),
        waver_phase=rng.uniform(0.0, 2.0 * np.pi, 2),
    )
