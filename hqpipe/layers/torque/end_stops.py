"""Samples at which a joint touches the end of its travel: there the drive does not decide the torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hqpipe.layers.torque.record import MOVING, Record, moving_speed
from hqpipe.logs.columns import joint_column
from hqpipe.logs.survey.signal import noise, resolution
from hqpipe.logs.trajectory import Trial
from hqpipe.logs.travel_ends import Stretch, held_ends

MARK = "at_end_stop"  # a column of samples that were marked before
FEWEST = 100  # moving samples that tell what it takes to move a joint; assumption: as in hqpipe.sysid.end_stops


def at_end_stops(records: Sequence[Record], trials: Sequence[Sequence[Trial]], joint: str) -> list[np.ndarray]:
    """(N,) of each record: whether the joint touches an end of its travel.

    An end of the travel is one where the joint repeatedly stands although its command asks for more torque than moves it
    elsewhere. Where the logs come with their samples marked, the marks count.

    Args:
        records: of the fit and the held-out trials. trials: those of each record.
    """
    column = joint_column(joint, MARK)
    every = [trial.trajectory for split in trials for trial in split]
    if any(column in t.extra for t in every):
        return [
            np.concatenate(
                [np.asarray(t.trajectory.extra.get(column, np.zeros(t.trajectory.samples))) > 0.5 for t in split]
            )
            if split
            else np.zeros(0, dtype=bool)
            for split in trials
        ]
    velocity, position, effort, command = (
        np.concatenate([getattr(r, name) for r in records]) for name in ("velocity", "position", "effort", "command")
    )
    usual = moving_speed(velocity)
    moving = np.abs(velocity) > MOVING * usual
    if usual == 0.0 or moving.sum() < FEWEST:
        return [np.zeros(len(r.position), dtype=bool) for r in records]
    # What it takes to move: a load that hangs on the position, and friction, dry and viscous.
    speed = velocity[moving]
    shapes = np.column_stack([np.ones(len(speed)), position[moving], np.sign(speed), speed])
    numbers = np.linalg.lstsq(shapes, effort[moving], rcond=None)[0]
    holds = max(float(numbers[2]), 0.0) + float(np.std(effort[moving] - shapes @ numbers))
    beyond = command - numbers[0] - numbers[1] * position
    push = np.where(np.abs(beyond) > holds, beyond, 0.0)
    stretches, at = [], 0
    for r in records:
        for first, last in zip(r.first, r.last, strict=True):
            part = slice(at + first, at + last + 1)
            stretches.append(Stretch(position[part], push[part]))
        at += len(r.position)
    step = resolution(position)
    sensor = noise(records[0].position, step) or (step or 0.0)
    ends = held_ends(stretches, records[0].dt, usual, sensor)
    nothing = [np.zeros(len(r.position), dtype=bool) for r in records]
    return [
        np.any([none, *(end.touched(r.position) for end in ends)], axis=0)
        for r, none in zip(records, nothing, strict=True)
    ]
