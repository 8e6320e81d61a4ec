"""Motions as engineers record them, as functions of time between two limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
BLEND_S = 1.0  # s, over which a motion starts from rest; assumption


@dataclass(frozen=True)
class Range:
    """Where a joint may go: `middle` ± `swing`, rad or m, at most at `speed` and `acceleration`."""

    middle: float
    swing: float
    speed: float
    acceleration: float


def sines(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """Two or three sines whose periods do not fit each other."""
    count = int(rng.integers(1, 4))
    shares = rng.dirichlet(np.full(count, 2.0))
    total = np.zeros_like(time)
    for share in shares:
        fastest = min(room.speed / room.swing, (room.acceleration / room.swing) ** 0.5)
        rate = fastest * rng.uniform(0.15, 0.7)
        total += share * np.sin(rate * time + rng.uniform(0.0, 2.0 * np.pi))
    return room.middle + room.swing * total


def chirp(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """A sine whose rate rises, and whose amplitude falls where speed or acceleration would not be kept."""
    high = (room.acceleration / room.swing) ** 0.5
    start, stop = 0.12 * high, rng.uniform(1.0, 1.8) * high
    rate = start * (stop / start) ** (time / time[-1])
    phase = np.cumsum(rate) * (time[1] - time[0])
    amplitude = np.minimum(room.swing, np.minimum(0.8 * room.speed / rate, 0.8 * room.acceleration / rate**2))
    return room.middle + amplitude * np.sin(phase)


def _stations(time: Array, room: Range, rng: np.random.Generator, hold: tuple[float, float], move: Callable) -> Array:
    """Go to random places one after the other and rest there.

    Args:
        hold: s, shortest and longest rest. move: distance → (duration in s, course over the share of that time).
    """
    result, at, now = np.empty_like(time), room.middle, 0.0
    done = 0
    while done < len(time):
        target = room.middle + room.swing * rng.uniform(-1.0, 1.0)
        if abs(target - at) < 0.3 * room.swing:
            target = 2.0 * room.middle - target
        duration, course = move(abs(target - at))
        until = now + duration + rng.uniform(*hold)
        last = int(np.searchsorted(time, until))
        share = np.clip((time[done:last] - now) / duration, 0.0, 1.0)
        result[done:last] = at + (target - at) * course(share)
        at, now, done = target, until, last
    return result


def smooth(share: Array) -> Array:
    """Course of least jerk, Flash and Hogan 1985."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def pick_and_place(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """Moves of least jerk between places, with rests."""

    def move(distance: float) -> tuple[float, Callable]:
        # the peaks of the course of least jerk are 1.875 distance/T and 5.77 distance/T²
        fastest = max(1.875 * distance / room.speed, (5.77 * distance / room.acceleration) ** 0.5)
        return float(fastest * rng.uniform(1.0, 1.8)), smooth

    return _stations(time, room, rng, (0.2, 0.8), move)


def trapezoids(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """Moves of trapezoidal speed, as drives plan them."""

    def move(distance: float) -> tuple[float, Callable]:
        ramp = rng.uniform(0.2, 0.4)  # share of the time
        fastest = max(
            distance / (room.speed * (1.0 - ramp)), (distance / (room.acceleration * ramp * (1.0 - ramp))) ** 0.5
        )

        def course(share: Array) -> Array:
            top = 1.0 / (1.0 - ramp)
            rising, falling = 0.5 * top * share**2 / ramp, 1.0 - 0.5 * top * (1.0 - share) ** 2 / ramp
            return np.where(share < ramp, rising, np.where(share > 1.0 - ramp, falling, top * (share - 0.5 * ramp)))

        return float(fastest * rng.uniform(1.0, 2.0)), course

    return _stations(time, room, rng, (0.1, 0.6), move)


def steps(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """Small steps, each run through a ramp of the highest speed."""
    small = Range(room.middle, 0.5 * room.swing, room.speed, room.acceleration)
    return _stations(time, small, rng, (0.6, 1.2), lambda distance: (max(distance / room.speed, 1e-3), lambda s: s))


def slow_sweep(time: Array, room: Range, rng: np.random.Generator) -> Array:
    """To and fro at a constant, low speed."""
    period = 4.0 * room.swing / (room.speed * rng.uniform(0.08, 0.2))
    phase = (time / period + rng.uniform()) % 1.0
    return room.middle + room.swing * (np.abs(4.0 * phase - 2.0) - 1.0)


MOTIONS: dict[str, Callable[[Array, Range, np.random.Generator], Array]] = {
    "sines": sines,
    "chirp": chirp,
    "pick_and_place": pick_and_place,
    "trapezoids": trapezoids,
    "steps": steps,
    "slow_sweep": slow_sweep,
}


def course(name: str, time: Array, room: Range, rng: np.random.Generator) -> Array:
    """(T,) a motion that starts at rest in the middle of its range.

    Args:
        name: of `MOTIONS`. time: (T,) s from 0, evenly spaced.
    """
    blend = smooth(np.clip(time / BLEND_S, 0.0, 1.0))
    return room.middle + blend * (MOTIONS[name](time, room, rng) - room.middle)
