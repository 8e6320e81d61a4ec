"""End stops of the joints: where they are, and which windows of the free run they spoil.

A joint on its end stop feels the stop, or its load cell no longer feels the oil behind it: no law from a command to the torque
explains what is logged there, nor an impact that is shorter than a sample. Such samples are no evidence for or against a model.
They are marked in a column beside the recorded ones, `joint/<name>/at_end_stop`. Trials stay in one piece, because integrators,
spools and the supply go on while a joint rests at its stop; windows that hold a marked sample are not judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hqpipe.logs.columns import joint_column
from hqpipe.logs.survey.end_stop import end_stops
from hqpipe.logs.survey.signal import difference_noise
from hqpipe.logs.trajectory import LogSet, Trajectory
from hqpipe.logs.travel_ends import CONTACT, NEAR, Stretch, TravelEnd, held_ends

MARK = "at_end_stop"
FASTEST, MOVING = 0.999, 0.1
"""Quantile of the speed that counts as the fastest, and its share from which a joint moves; assumption: as in valve mode."""
FEWEST = 100  # moving samples that tell what it takes to move a joint; assumption

Travel = Mapping[str, tuple[float, float]]
"""Joint → lowest and highest position, as a description of the robot states them."""


def mark_end_stops(log_set: LogSet, travel: Travel | None = None) -> tuple[LogSet, tuple[str, ...]]:
    """The log set with the samples marked at which a joint touches an end stop, and a line about each such joint.

    In torque mode a stop is an end of the travel where the joint repeatedly stands although it is pushed on by more than it
    takes to move it elsewhere; in position mode one where it stands while its command moves on beyond it
    (`hqpipe.logs.survey.end_stop`). Stated limits of the travel are stops where the joint reaches and does not pass them.

    Args:
        log_set: of torque or position mode, with the channels of its mode. travel: stated limits, unit of the position.
    """
    trials = [trial.trajectory for trial in log_set.trials]
    marks = [np.zeros(t.position.shape, dtype=bool) for t in trials]
    torque, told = log_set.control_mode == "torque", []
    known = [] if torque else end_stops([(trial.file, trial.trajectory) for trial in log_set.trials])
    for j, joint in enumerate(log_set.joints):
        ends = _pushed(trials, j) if torque else _commanded(trials, j, [s.position for s in known if s.joint == joint])
        ends += _stated(trials, j, (travel or {}).get(joint))
        touched = [np.any([end.touched(t.position[:, j]) for end in ends], axis=0) for t in trials if ends]
        share = float(np.mean(np.concatenate(touched))) if ends else 0.0
        if share > 0.0:
            for mark, here in zip(marks, touched, strict=True):
                mark[:, j] = here
            hit = [end for end in ends if any(end.touched(t.position[:, j]).any() for t in trials)]
            told.append(_text(joint, hit, touched, share))
    if not told:
        return log_set, ()
    trials = [
        replace(trial, trajectory=_marked(trial.trajectory, mark))
        for trial, mark in zip(log_set.trials, marks, strict=True)
    ]
    return replace(log_set, trials=tuple(trials)), tuple(told)


def at_end_stop(t: Trajectory) -> np.ndarray | None:
    """(T, J) whether a joint touches an end stop; None where none does."""
    marks = [t.extra.get(joint_column(joint, MARK)) for joint in t.joints]
    if all(mark is None for mark in marks):
        return None
    return np.stack([np.zeros(t.samples, dtype=bool) if mark is None else mark > 0.5 for mark in marks], axis=1)


def judged_windows(t: Trajectory, steps: int) -> np.ndarray | None:
    """(windows, J) whether a window of `steps` samples, its start among them, is free of end stops; None where all are."""
    marks = at_end_stop(t)
    if marks is None:
        return None
    before = np.concatenate([np.zeros((1, marks.shape[1]), dtype=np.int64), np.cumsum(marks, axis=0)])
    starts = np.arange(0, t.samples - steps, steps)
    return before[starts + steps + 1] == before[starts]


def away_from_stops(t: Trajectory, j: int, values: np.ndarray) -> np.ndarray:
    """Of (T,) values those that belong to samples at which joint `j` touches no end stop."""
    marks = at_end_stop(t)
    return values if marks is None else values[~marks[:, j]]


def _marked(t: Trajectory, mark: np.ndarray) -> Trajectory:
    columns = {joint_column(joint, MARK): mark[:, j].astype(np.float64) for j, joint in enumerate(t.joints)}
    return replace(t, extra={**t.extra, **columns})


def _pushed(trials: Sequence[Trajectory], j: int) -> list[TravelEnd]:
    """Ends of the travel where a joint stands although its command asks for more torque than moves it elsewhere."""
    speed = np.concatenate([t.velocity[:, j] for t in trials])
    moving = np.abs(speed) > MOVING * np.quantile(np.abs(speed), FASTEST)
    if moving.sum() < FEWEST:
        return []
    position, effort = (np.concatenate([getattr(t, name)[:, j] for t in trials]) for name in ("position", "effort"))
    # What it takes to move: a load that hangs on the position, and friction, dry and viscous.
    shapes = np.column_stack([np.ones(moving.sum()), position[moving], np.sign(speed[moving]), speed[moving]])
    numbers, *_ = np.linalg.lstsq(shapes, effort[moving], rcond=None)
    beside = float(np.std(effort[moving] - shapes @ numbers))  # what inertia and impacts add
    holds = max(float(numbers[2]), 0.0) + beside
    stretches = []
    for t in trials:
        beyond = t.effort_command[:, j] - numbers[0] - numbers[1] * t.position[:, j]
        stretches.append(Stretch(t.position[:, j], np.where(np.abs(beyond) > holds, beyond, 0.0)))
    usual = float(np.sqrt(np.mean(speed[moving] ** 2)))
    noise = difference_noise([t.position[:, j] for t in trials])
    return held_ends(stretches, float(np.median([t.dt for t in trials])), usual, noise)


def _commanded(trials: Sequence[Trajectory], j: int, stops: Sequence[float]) -> list[TravelEnd]:
    """Ends of the travel beyond which a position command moves on while the joint stands there."""
    low, high = _range(trials, j)
    contact, upper = CONTACT * (high - low), [stop > 0.5 * (low + high) for stop in stops]
    return [TravelEnd(s - contact if up else s + contact, up) for s, up in zip(stops, upper, strict=True)]


def _stated(trials: Sequence[Trajectory], j: int, limits: tuple[float, float] | None) -> list[TravelEnd]:
    """Stated limits as stops; one that the joint passes is none, or belongs to another zero of the encoder."""
    if limits is None:
        return []
    (low, high), found = _range(trials, j), []
    travel = limits[1] - limits[0]
    if high <= limits[1] + NEAR * travel:
        found.append(TravelEnd(limits[1] - CONTACT * travel, True))
    if low >= limits[0] - NEAR * travel:
        found.append(TravelEnd(limits[0] + CONTACT * travel, False))
    return found


def _range(trials: Sequence[Trajectory], j: int) -> tuple[float, float]:
    return min(float(t.position[:, j].min()) for t in trials), max(float(t.position[:, j].max()) for t in trials)


def _text(joint: str, ends: Sequence[TravelEnd], touched: Sequence[np.ndarray], share: float) -> str:
    places = " and ".join(f"{end.position:.4g}" for end in ends)
    samples = sum(int(here.sum()) for here in touched)
    trials = sum(here.any() for here in touched)
    return (
        f"{joint} rests on or hits an end stop near {places}: {samples} samples ({share:.1%}) in {trials} trials are left out, "
        "with the windows that hold them, for no law from command to torque holds there"
    )
