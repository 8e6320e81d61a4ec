"""Sizes of a joint's signals in the fit trials, that bounds and priors are multiples of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.logs.end_stops import away_from_stops
from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import Trajectory
from hqpipe.machine import effect as scales

TRAVEL = 1.0
"""rad: half of the stroke of a joint that turns by 2 rad. A slide has any stroke, and its trials are taken to use half of it;
assumptions."""
LITTLE, AT_TIMES = 0.3, 0.1  # of the usual flow, and of the time; a sine is below that for 0.14 of it; assumptions


@dataclass(frozen=True)
class Sizes:
    """Of one joint.

    Attributes:
        of: scale of an effect's parameter → its size, see `hqpipe.machine.effect`. most_effort: largest torque.
        widest: largest position error. middle: of the positions. noise: of the torque's sensor, standard deviation.
        pauses: whether little is drawn from the supply at times.
    """

    of: dict[str, float]
    most_effort: float
    widest: float
    middle: float
    noise: float
    pauses: bool

    @property
    def natural(self) -> dict[str, float]:
        """Coefficient of the base model → the size that these signals give it."""
        effort = self.of[scales.EFFORT]
        return {
            "k1": effort / self.of[scales.COMMAND],
            "k2": 1.0,
            "k3": effort / self.of[scales.VELOCITY],
            "k4": 1.0 / self.of[scales.COMMAND],
        }


def at_rest(trials: Sequence[Trajectory], j: int) -> str | None:
    """Why joint `j` shows no law from its command to its torque away from its end stops; None where it may."""
    effort, position, velocity = (
        np.concatenate([away_from_stops(t, j, getattr(t, name)[:, j]) for t in trials])
        for name in ("effort", "position", "velocity")
    )
    command = np.concatenate([away_from_stops(t, j, t.position_command[:, j]) for t in trials])
    if np.ptp(effort) == 0.0:
        return "its measured torque never changes"
    if np.ptp(position) == 0.0 or not velocity.any():
        return "it never moves"
    if np.array_equal(command, position):
        return "its commanded position is its position in every sample: log what the controller is sent"
    return None


def sizes_of(
    trials: Sequence[Trajectory], j: int, draws: np.ndarray, slides: bool = False, alike: Sequence[int] = ()
) -> Sizes:
    """Sizes of joint `j`, which is not `at_rest`, away from its end stops.

    Args:
        draws: (J,) what the speed of each joint counts in the flow. slides: whether the joint is known to slide.
        alike: joints whose speeds have its unit.
    """

    def together(pick: Callable[[Trajectory], np.ndarray]) -> np.ndarray:
        return np.concatenate([away_from_stops(t, j, pick(t)) for t in trials])

    error = together(lambda t: (t.position_command - t.position)[:, j])
    effort, velocity = together(lambda t: t.effort[:, j]), together(lambda t: t.velocity[:, j])
    position = together(lambda t: t.position[:, j])
    drawn = np.concatenate([np.abs(t.velocity) @ draws for t in trials])
    flow, angle = _rms(drawn), float(np.std(position))
    travel = float(np.ptp(position)) if slides else TRAVEL
    speed = _rms(velocity)
    others = [_rms(np.concatenate([t.velocity[:, k] for t in trials])) for k in alike]
    return Sizes(
        of={
            scales.SECOND: 1.0,
            scales.NONE: 1.0,
            scales.COMMAND: _rms(error),
            scales.EFFORT: _rms(effort),
            scales.VELOCITY: speed,
            scales.USUAL_VELOCITY: max(speed, float(np.median(others))) if others else speed,
            scales.SLOWNESS: 1.0 / flow,
            scales.FLOW: flow,
            scales.ANGLE: angle,
            scales.TRAVEL: travel,
            scales.CURVE: 1.0 / travel,
            scales.DAMPING: _rms(effort) / speed,
            scales.STIFFNESS: _rms(effort) / angle,
        },
        most_effort=float(np.abs(effort).max()),
        widest=float(np.abs(error).max()),
        middle=float(position.mean()),
        noise=difference_noise([t.effort[:, j] for t in trials]),
        pauses=bool(np.mean(drawn < LITTLE * flow) >= AT_TIMES),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
