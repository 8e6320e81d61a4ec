"""One joint of all trials of a split, stretch after stretch, as the kernel reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.layers.torque import kernel
from hqpipe.logs.end_stops import at_end_stop
from hqpipe.logs.trajectory import Trajectory, Trial, recording_of

SUPPLY = "supply/pressure"
FULL_SUPPLY = 0.95  # quantile of the logged supply pressure that counts as full; above it are its peaks; assumption
MOVING, FASTEST = 0.1, 0.999
"""Share of the fastest speed, a quantile, from which a joint moves; assumption: as in valve mode."""


@dataclass(frozen=True)
class Scales:
    """Sizes of a joint's signals in the fit trials.

    Attributes:
        middle, half_travel: of the position. effort: root mean square about its mean; most_effort: largest. error: root mean
            square of command less effort. speed: root mean square of the velocity where it moves. speeds: (J,) of all joints.
        longest_s: of the trials. supply: full supply pressure, or 0.
    """

    middle: float
    half_travel: float
    effort: float
    most_effort: float
    error: float
    speed: float
    speeds: tuple[float, ...]
    longest_s: float
    supply: float


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one joint; N of all stretches together.

    Attributes:
        dt: s. files: recordings. trial: (N,) index into them. first, last: (S,) first and last sample of each stretch.
        stretch: (N,) index into these. time: (N,) s since the recording began.
        command, effort, position, velocity: (N,). observed: (N,).
        masked: (N,) at an end stop. supply: whether its pressure was logged.
        signals: (7, N) see `kernel`. means: (S, 3) of each stretch, see `kernel`.
    """

    dt: float
    files: tuple[str, ...]
    trial: np.ndarray
    first: np.ndarray
    last: np.ndarray
    stretch: np.ndarray
    time: np.ndarray
    command: np.ndarray
    effort: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    observed: np.ndarray
    masked: np.ndarray
    supply: bool
    signals: np.ndarray
    means: np.ndarray


def scales_of(trials: Sequence[Trial], j: int) -> Scales:
    """The sizes of joint `j` in the fit trials."""
    parts = [t.trajectory for t in trials]
    position, command, effort = (
        np.concatenate([getattr(t, name)[:, j] for t in parts]) for name in ("position", "effort_command", "effort")
    )
    low, high = float(position.min()), float(position.max())
    speeds = [moving_speed(v) for v in np.concatenate([t.velocity for t in parts]).T]
    supply = [t.extra[SUPPLY] for t in parts if SUPPLY in t.extra]
    full = float(np.quantile(np.concatenate(supply), FULL_SUPPLY)) if len(supply) == len(parts) else 0.0
    return Scales(
        middle=0.5 * (low + high),
        half_travel=0.5 * (high - low),
        effort=float(np.std(effort)),
        most_effort=float(np.abs(effort).max()),
        error=float(np.sqrt(np.mean((command - effort) ** 2))),
        speed=speeds[j],
        speeds=tuple(speeds),
        longest_s=max(t.start + t.duration for t in parts),
        supply=full,
    )


def _touched(t: Trajectory, j: int) -> np.ndarray:
    """(T,) whether joint `j` touches an end of its travel, where the drive does not decide the torque."""
    marks = at_end_stop(t)
    return np.zeros(t.samples, dtype=bool) if marks is None else marks[:, j]


def moving_speed(velocity: np.ndarray) -> float:
    """Root mean square of the velocity over the samples faster than a tenth of the fastest."""
    size = np.abs(velocity)
    moving = size > MOVING * np.quantile(size, FASTEST)
    return float(np.sqrt(np.mean(velocity[moving] ** 2))) if moving.any() else 0.0


def record_of(trials: Sequence[Trial], j: int, scales: Scales, dt: float) -> Record:
    """The samples of joint `j`; dt: s, of the log set."""
    parts = [t.trajectory for t in trials]
    names = [recording_of(t) for t in trials]
    files = tuple(dict.fromkeys(names))
    lengths = np.array([t.samples for t in parts], dtype=np.int64)
    bounds = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    def joined(pick) -> np.ndarray:
        return np.concatenate([np.asarray(pick(t), dtype=np.float64) for t in parts]) if parts else np.zeros(0)

    position, velocity = joined(lambda t: t.position[:, j]), joined(lambda t: t.velocity[:, j])
    time = joined(lambda t: t.time - t.time[0] + t.start)
    supply = scales.supply > 0.0 and all(SUPPLY in t.extra for t in parts)
    signals = np.zeros((kernel.SIGNALS, len(position)))
    signals[kernel.TIME], signals[kernel.Z] = time, (position - scales.middle) / max(scales.half_travel, 1e-300)
    signals[kernel.VELOCITY] = velocity
    others = (np.arange(len(scales.speeds)) != j) & (np.array(scales.speeds) > 0.0)
    if supply:
        signals[kernel.LOSS] = joined(lambda t: np.clip(1.0 - t.extra[SUPPLY] / scales.supply, 0.0, 1.0))
    elif others.any():
        usual = np.array(scales.speeds)[others]
        signals[kernel.OTHER_SPEED] = joined(lambda t: (np.abs(t.velocity[:, others]) / usual).sum(axis=1))
    _integrate(signals, joined(lambda t: t.effort_command[:, j]), joined(lambda t: t.effort[:, j]), bounds, dt)
    return Record(
        dt=dt,
        files=files,
        trial=np.repeat([files.index(name) for name in names], lengths).astype(np.int64),
        first=bounds[:-1],
        last=bounds[1:] - 1,
        stretch=np.repeat(np.arange(len(parts)), lengths),
        time=time,
        command=joined(lambda t: t.effort_command[:, j]),
        effort=joined(lambda t: t.effort[:, j]),
        position=position,
        velocity=velocity,
        observed=joined(lambda t: t.recorded[:, j]).astype(bool),
        masked=joined(lambda t: _touched(t, j)).astype(bool),
        supply=supply,
        signals=signals,
        means=np.array([_means(t, j) for t in parts]).reshape(-1, 3),
    )


def _integrate(signals: np.ndarray, command: np.ndarray, effort: np.ndarray, bounds: np.ndarray, dt: float) -> None:
    """Fill in the integrals of command and effort since each stretch began, whose difference has no mean there."""
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        asked, given = (np.cumsum(x[a:b]) - x[a:b] for x in (command, effort))
        signals[kernel.COMMAND_SUM, a:b] = asked * dt
        signals[kernel.EFFORT_SUM, a:b] = (given + np.mean(asked - given)) * dt


def _means(t: Trajectory, j: int) -> list[float]:
    """Means over a stretch, see `kernel`."""
    error = t.effort_command[:, j] - t.effort[:, j]
    return [float(np.mean(x)) for x in (error, t.velocity[:, j], t.effort[:, j])]
