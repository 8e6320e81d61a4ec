"""One joint of all trials of a split, stretch after stretch, as the kernel reads it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hqpipe.layers.valve import kernel
from hqpipe.logs.trajectory import Trial, recording_of

SUPPLY = "supply/pressure"
FULL_SUPPLY = 0.95  # quantile of the logged supply pressure that counts as full; above it are its peaks; assumption

CLASSES, OFTEN, INNER = 500, 0.1, 0.1
"""Classes of the command; share of the samples that makes one of them the rest; share of the range next to either end, where
no rest lies. assumption: a joystick or controller at rest holds one value, within the range that it commands."""


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one joint; N of all stretches together.

    Attributes:
        dt: s. files: recordings. trial: (N,) index into them. first, last: (S,) first and last sample of each stretch.
        stretch: (N,) index into these. time: (N,) s since the recording began.
        command, position, velocity: (N,); `velocity` as logged, or differentiated. observed: (N,).
        effort: (N,) load, 0 where there is none; `effort_unit` is then "". supply: whether its pressure was logged.
        signals: (10, N) see `kernel`.
    """

    dt: float
    files: tuple[str, ...]
    trial: np.ndarray
    first: np.ndarray
    last: np.ndarray
    stretch: np.ndarray
    time: np.ndarray
    command: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    observed: np.ndarray
    effort: np.ndarray
    effort_unit: str
    supply: bool
    signals: np.ndarray


@dataclass(frozen=True)
class Scales:
    """Sizes of a joint's signals in the fit trials.

    Attributes:
        middle, half_travel: of the position. rest: the command at which the joint is left alone. command: largest distance
            from it. speed: root mean square of the velocity where it moves. speeds: (J,) that of all joints.
        rests, commands: (J,) rest and largest distance of the commands of all joints. supply: full supply pressure, or 0.
    """

    middle: float
    half_travel: float
    rest: float
    command: float
    speed: float
    speeds: tuple[float, ...]
    rests: tuple[float, ...]
    commands: tuple[float, ...]
    supply: float


def scales_of(trials: Sequence[Trial], j: int) -> Scales:
    """The sizes of joint `j` in the fit trials."""
    position = np.concatenate([t.trajectory.position[:, j] for t in trials])
    low, high = float(position.min()), float(position.max())
    commands = np.concatenate([t.trajectory.valve_command for t in trials])
    velocities = np.concatenate([t.trajectory.velocity for t in trials])
    rests = np.array([rest_command(u, v) for u, v in zip(commands.T, velocities.T, strict=True)])
    distances = np.abs(commands - rests).max(axis=0)
    speeds = [_moving_speed(v) for v in velocities.T]
    supply = [t.trajectory.extra[SUPPLY] for t in trials if SUPPLY in t.trajectory.extra]
    full = float(np.quantile(np.concatenate(supply), FULL_SUPPLY)) if len(supply) == len(trials) else 0.0
    return Scales(
        middle=0.5 * (low + high),
        half_travel=0.5 * (high - low),
        rest=float(rests[j]),
        command=float(distances[j]),
        speed=speeds[j],
        speeds=tuple(speeds),
        rests=tuple(rests.tolist()),
        commands=tuple(distances.tolist()),
        supply=full,
    )


def rest_command(command: np.ndarray, velocity: np.ndarray) -> float:
    """The command at which a joint is left alone: the one that it has most often, away from both ends of its range.

    Where there is none, as in a steady to and fro, the command at which a straight line through the moving samples crosses zero
    speed. command, velocity: (N,).
    """
    low, high = float(command.min()), float(command.max())
    if low == high:
        return low
    kind = np.minimum((CLASSES * (command - low) / (high - low)).astype(int), CLASSES - 1)
    most = int(np.bincount(kind).argmax())
    often = kind == most
    if often.mean() > OFTEN and INNER * CLASSES < most < (1.0 - INNER) * CLASSES:
        return float(np.median(command[often]))
    size = np.abs(velocity)
    moving = size > 0.1 * np.quantile(size, 0.999)
    away = command[moving] - command[moving].mean() if moving.any() else np.zeros(1)
    slope = float(away @ velocity[moving]) / max(float(away @ away), 1e-300) if moving.any() else 0.0
    if slope == 0.0:
        return float(np.median(command))
    crossing = float(command[moving].mean() - velocity[moving].mean() / slope)
    return float(np.clip(crossing, low + INNER * (high - low), high - INNER * (high - low)))


def _moving_speed(velocity: np.ndarray) -> float:
    """Root mean square of the velocity over the samples faster than a tenth of the fastest."""
    size = np.abs(velocity)
    moving = size > 0.1 * np.quantile(size, 0.999)
    return float(np.sqrt(np.mean(velocity[moving] ** 2))) if moving.any() else 0.0


def record_of(
    trials: Sequence[Trial], j: int, scales: Scales, same: np.ndarray, linear: bool, alike: np.ndarray, dt: float
) -> Record:
    """The samples of joint `j`.

    Args:
        same: (J,) joints of the same kind. linear: whether the joint slides.
        alike: (J,) factors that give the speeds of other joints the size of this one's.
        dt: s, of the log set.
    """
    parts = [t.trajectory for t in trials]
    names = [recording_of(t) for t in trials]
    files = tuple(dict.fromkeys(names))
    lengths = np.array([t.samples for t in parts], dtype=np.int64)
    bounds = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    def joined(pick) -> np.ndarray:
        return np.concatenate([np.asarray(pick(t), dtype=np.float64) for t in parts]) if parts else np.zeros(0)

    effort, unit = _load(parts, j, joined, linear)
    position = joined(lambda t: t.position[:, j])
    time = joined(lambda t: t.time - t.time[0] + t.start)
    supply = scales.supply > 0.0 and all(SUPPLY in t.extra for t in parts)
    signals = _other_joints(joined, j, scales, same, alike, supply, len(position))
    z = (position - scales.middle) / scales.half_travel
    signals[kernel.TIME], signals[kernel.Z], signals[kernel.EFFORT] = time, z, effort
    signals[kernel.FREE] = 1.0
    signals[kernel.SIN], signals[kernel.COS] = (z, z * z) if linear else (np.sin(position), np.cos(position))
    return Record(
        dt=dt,
        files=files,
        trial=np.repeat([files.index(name) for name in names], lengths).astype(np.int64),
        first=bounds[:-1],
        last=bounds[1:] - 1,
        stretch=np.repeat(np.arange(len(parts)), lengths),
        time=time,
        command=joined(lambda t: t.valve_command[:, j]),
        position=position,
        velocity=joined(lambda t: t.velocity[:, j]),
        observed=joined(lambda t: t.recorded[:, j]).astype(bool),
        effort=effort,
        effort_unit=unit,
        supply=supply,
        signals=signals,
    )


def _other_joints(
    joined, j: int, scales: Scales, same: np.ndarray, alike: np.ndarray, supply: bool, samples: int
) -> np.ndarray:
    """(10, N) signals, of which what the other joints and the supply do is filled in."""
    signals = np.zeros((10, samples))
    others = np.arange(len(scales.speeds)) != j
    sizes = np.maximum(np.array(scales.commands), 1e-300)
    if others.any():
        signals[kernel.OTHER_OPENING] = joined(
            lambda t: (np.abs(t.valve_command - scales.rests) / sizes)[:, others].mean(axis=1)
        )
    if supply:
        signals[kernel.LOSS] = joined(lambda t: np.clip(1.0 - t.extra[SUPPLY] / scales.supply, 0.0, 1.0))
    elif others.any():
        for row, kind in ((kernel.OTHER_SPEED, same), (kernel.OTHER_KIND, ~same)):
            if (others & kind).any():
                signals[row] = joined(lambda t, k=others & kind: (np.abs(t.velocity) * alike)[:, k].sum(axis=1))
    return signals


def _load(parts, j: int, joined, linear: bool) -> tuple[np.ndarray, str]:
    """The load on the joint: its effort, else the difference of the chamber pressures."""
    if parts and all(t.effort is not None for t in parts):
        return joined(lambda t: t.effort[:, j]), "N" if linear else "N·m"
    if parts and all(t.pressure_a is not None and t.pressure_b is not None for t in parts):
        return joined(lambda t: t.pressure_a[:, j] - t.pressure_b[:, j]), "Pa"
    return joined(lambda t: np.zeros(t.samples)), ""
