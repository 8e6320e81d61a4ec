"""A first look at the logs: a straight line from command to speed, its delay, and where motion sets in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.valve.kernel import OTHER_SPEED
from hqpipe.layers.valve.masks import smooth_speed
from hqpipe.layers.valve.parameters import MOST_DELAY_S, Sizes
from hqpipe.layers.valve.record import Record, Scales

SPAN_S = 0.1  # over which a speed is averaged; assumption: short beside a stroke
CLASSES = 50  # of the command's size, among which the edge of a deadband is looked for; assumption
MOVES = 0.15  # of the usual speed, beyond which the joint moves; assumption
MOST_SHIFTS = 25  # delays that are tried; assumption


@dataclass(frozen=True)
class Look:
    """A straight line through the logs.

    Attributes:
        gain: unit of the position per s and command. neutral: command. delay_s: for which the command comes before the speed.
        edge: distance from rest at which the joint starts to move, as far as can be seen.
    """

    gain: float
    neutral: float
    delay_s: float
    edge: float


def first_look(record: Record, scales: Scales) -> Look:
    """Gain, neutral point and delay of the straight line that fits best, and the edge of the deadband behind it."""
    span = max(round(SPAN_S / record.dt), 2)
    speed = smooth_speed(record, span)
    most = round(MOST_DELAY_S / record.dt)
    best = (np.inf, 0, 0.0, 0.0)
    for shift in np.unique(np.linspace(0, most, min(most + 1, MOST_SHIFTS)).round().astype(int)):
        here = np.arange(len(speed)) - record.first[record.stretch] >= most
        command, answer = record.command[np.flatnonzero(here) - shift], speed[here]
        spread = command - command.mean()
        gain = float(spread @ answer) / max(float(spread @ spread), 1e-300)
        error = float(np.sum((answer - answer.mean() - gain * spread) ** 2))
        if error < best[0]:
            best = (error, int(shift), gain, float(command.mean() - answer.mean() / gain if gain else scales.rest))
    _, shift, gain, neutral = best
    neutral = float(np.clip(neutral, scales.rest - scales.command, scales.rest + scales.command))
    return Look(gain, neutral, shift * record.dt, _edge(record, scales, speed, shift))


def _edge(record: Record, scales: Scales, speed: np.ndarray, shift: int) -> float:
    """The distance of the command from rest that best tells where the joint moves from where it stands."""
    index = np.maximum(np.arange(len(speed)) - shift, record.first[record.stretch])
    size = np.abs(record.command[index] - scales.rest)
    moves = np.abs(speed) > MOVES * scales.speed
    edges = np.linspace(0.0, scales.command, CLASSES + 1)[1:-1]
    wrong = [
        np.mean(size[~moves] > e) + np.mean(size[moves] <= e) if moves.any() and not moves.all() else 1.0 for e in edges
    ]
    return float(edges[int(np.argmin(wrong))])


def sizes_of(record: Record, scales: Scales, look: Look, joints: int, slides: bool) -> Sizes:
    """What bounds and priors are multiples of."""
    effort = float(np.sqrt(np.mean((record.effort - record.effort.mean()) ** 2)))
    return Sizes(
        dt=record.dt,
        command=scales.command,
        gain=look.gain,
        neutral=look.neutral,
        speed=scales.speed,
        effort=effort if record.effort_unit else 0.0,
        most_effort=float(np.quantile(np.abs(record.effort), 0.999)) if record.effort_unit else 0.0,
        effort_unit=record.effort_unit,
        demand=scales.speed if joints == 1 else scales.speed + _others(record),
        supply=record.supply,
        alone=joints == 1,
        edge=look.edge,
        delay_s=look.delay_s,
        speed_unit="m/s" if slides else "rad/s",
    )


def _others(record: Record) -> float:
    return float(np.sqrt(np.mean(record.signals[OTHER_SPEED] ** 2)))
