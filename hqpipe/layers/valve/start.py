"""A first look at the logs: a straight line from command to speed, its delay, and where motion sets in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hqpipe.layers.valve.kernel import OTHER_KIND, OTHER_SPEED
from hqpipe.layers.valve.masks import runs, smooth_speed
from hqpipe.layers.valve.parameters import MOST_DELAY_S, Sizes
from hqpipe.layers.valve.record import Record, Scales

SPAN_S = 0.1  # over which a speed is averaged; assumption: short beside a stroke
CLASSES = 50  # of the command's size, among which the edge of a deadband is looked for; assumption
MOVES = 0.15  # of the usual speed, beyond which the joint moves; assumption
MOST_SHIFTS = 25  # delays that are tried; assumption
LEFT_ALONE, SETTLE_S = 0.02, 0.5  # a joint is left alone, as in `noise`: of the command's largest distance from rest; s
FEWEST_RESTS, SURE = 5, 9.0  # rests that show a creep; its square over that of its standard error: three of them
CREEPS = 0.002  # of the usual speed, below which a creep is of no use to anybody: a tenth of `parameters.CREEP`
FARTHEST = 0.99  # quantile of a side's commands that counts as the largest; the rest may be glitches
AS_FAR = 0.7  # of the other side's largest command, from which both directions were driven alike; assumption
FEWEST = 20  # samples at a level of the command; assumption


@dataclass(frozen=True)
class Look:
    """A straight line through the logs.

    Attributes:
        gain: unit of the position per s and command. neutral: command. delay_s: for which the command comes before the speed.
        edge: distance from rest at which the joint starts to move, as far as can be seen.
        full: distance from neutral beyond which it moves no faster.
        creeps: whether it creeps at rest. slower: direction that flattens off at large commands, 0 if that cannot be told.
    """

    gain: float
    neutral: float
    delay_s: float
    edge: float
    full: float
    creeps: bool
    slower: int


def first_look(record: Record, scales: Scales) -> Look:
    """What can be seen before anything is fitted."""
    span = max(round(SPAN_S / record.dt), 2)
    speed = smooth_speed(record, span)
    most = round(MOST_DELAY_S / record.dt)
    coarse = np.unique(np.linspace(0, most, min(most + 1, MOST_SHIFTS)).round().astype(int))
    lines = {int(shift): _line(record, speed, int(shift), most) for shift in coarse}
    shift = min(lines, key=lambda shift: lines[shift][0])
    _, gain, neutral = lines[shift]
    if gain == 0.0:
        neutral = scales.rest
    neutral = float(np.clip(neutral, scales.rest - scales.command, scales.rest + scales.command))
    edge = _edge(record, scales, speed, shift)
    full = _full(record, scales, speed, shift, neutral)
    slower = _slower(record, speed, shift, gain, neutral)
    return Look(gain, neutral, shift * record.dt, edge, full, _creeps(record, scales), slower)


def _line(record: Record, speed: np.ndarray, shift: int, most: int) -> tuple[float, float, float]:
    """Squared error, gain and zero of the straight line from the command `shift` samples before to the speed."""
    here = np.flatnonzero(np.arange(len(speed)) - record.first[record.stretch] >= most)
    if not len(here):
        return np.inf, 0.0, 0.0
    command, answer = record.command[here - shift], speed[here]
    spread = command - command.mean()
    gain = float(spread @ answer) / max(float(spread @ spread), 1e-300)
    error = float(np.sum((answer - answer.mean() - gain * spread) ** 2))
    return error, gain, float(command.mean() - answer.mean() / gain) if gain else 0.0


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


def _full(record: Record, scales: Scales, speed: np.ndarray, shift: int, neutral: float) -> float:
    """The distance of the command from neutral beyond which the speed rises no more, as far as a straight line to it tells."""
    index = np.maximum(np.arange(len(speed)) - shift, record.first[record.stretch])
    beyond = record.command[index] - neutral
    limits = np.linspace(0.0, scales.command, CLASSES + 1)[1:]
    errors = []
    for limit in limits:
        opening = np.clip(beyond, -limit, limit)
        gain = float(opening @ speed) / max(float(opening @ opening), 1e-300)
        errors.append(float(np.sum((speed - gain * opening) ** 2)))
    return float(limits[int(np.argmin(errors))])


def _creeps(record: Record, scales: Scales) -> bool:
    """Whether the joint moves while it is left alone: to one side, or as its load pushes."""
    settle, alone = round(SETTLE_S / record.dt), np.abs(record.command - scales.rest) <= LEFT_ALONE * scales.command
    rests = [(a + settle, b) for a, b in runs(alone & record.observed, record.stretch) if b - a - settle >= settle]
    if len(rests) < FEWEST_RESTS:
        return False
    speed = np.array([(record.position[b - 1] - record.position[a]) / (b - 1 - a) / record.dt for a, b in rests])
    push = np.column_stack([np.ones(len(rests)), [record.effort[a:b].mean() for a, b in rests]])
    found = np.linalg.lstsq(push, speed, rcond=None)[0]
    freedom = len(rests) - np.linalg.matrix_rank(push)
    explained, left = float(np.sum((push @ found) ** 2)), float(np.sum((speed - push @ found) ** 2))
    return explained > SURE * left / max(freedom, 1) and explained / len(rests) > (CREEPS * scales.speed) ** 2


def _slower(record: Record, speed: np.ndarray, shift: int, gain: float, neutral: float) -> int:
    """The direction of motion whose speed flattens off at large commands, if the other one was driven as far."""
    index = np.maximum(np.arange(len(speed)) - shift, record.first[record.stretch])
    beyond = record.command[index] - neutral
    far = [float(np.quantile(np.maximum(side * beyond, 0.0), FARTHEST)) for side in (1.0, -1.0)]
    if min(far) < AS_FAR * max(far):
        return 0
    rise = {}
    for side in (1.0, -1.0):
        levels = []
        for share in (0.5, 0.9):
            here = np.abs(side * beyond - share * min(far)) < 0.1 * min(far)
            levels.append(float(np.median(np.abs(speed[here]))) if here.sum() >= FEWEST else np.nan)
        rise[side] = levels[1] / levels[0] if levels[0] > 0.0 else np.nan  # it has not begun to move
    if not np.isfinite(list(rise.values())).all():
        return 0
    side = min(rise, key=lambda side: rise[side])
    return int(side) if gain > 0.0 else -int(side)


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
        kinds=bool(record.signals[OTHER_KIND].any()),
        edge=look.edge,
        full=look.full,
        delay_s=look.delay_s,
        creeps=look.creeps,
        slower=look.slower,
        longest_s=float(record.time.max()),
        speed_unit="m/s" if slides else "rad/s",
    )


def _others(record: Record) -> float:
    return float(np.sqrt(np.mean((record.signals[OTHER_SPEED] + record.signals[OTHER_KIND]) ** 2)))
