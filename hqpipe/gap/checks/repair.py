"""What the logs would be if a defect of theirs were mended: for comparison, never for an answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hqpipe.gap.checks.defect import Defect
from hqpipe.gap.checks.signs import with_signs
from hqpipe.logs.differentiate import differentiate
from hqpipe.logs.trajectory import LogSet, Trajectory

SCALED = ("position", "velocity", "position_command")  # by another unit of a joint's travel

Mend = Callable[[Trajectory, str], Trajectory]


def repairs(defect: Defect, log_set: LogSet) -> list[LogSet]:
    """The log set with the defect mended, in each way that it could be; empty where what was lost cannot be known."""
    columns = [log_set.joints.index(joint) for joint in defect.joints]
    if defect.order:
        return [_mended(log_set, defect, lambda t, file: _reordered(t, defect.order[file]))]
    if defect.channel == "velocity":
        return [_mended(log_set, defect, lambda t, file: derived(t, _columns(defect, log_set, file)))]
    if defect.kind == "swapped":
        turns = (columns[turn:] + columns[:turn] for turn in range(1, len(columns)))
        names = defect.channels or (defect.channel,)
        return [_mended(log_set, defect, lambda t, _, s=source: _moved(t, names, columns, s)) for source in turns]
    if defect.kind == "sign_flipped":
        return [_mended(log_set, defect, lambda t, _: _changed(t, (defect.channel,), columns, np.negative))]
    if defect.kind == "other_units":
        scale, every = 1.0 / defect.factor, list(range(len(log_set.joints)))
        return [_mended(log_set, defect, lambda t, _: _changed(t, SCALED, every, lambda v: scale * v))]
    if defect.kind == "held_samples":
        return [_mended(log_set, defect, lambda t, _: _changed(t, (defect.channel,), columns, joined_up))]
    if defect.kind == "unsigned" and defect.channel == "effort" and log_set.control_mode == "position":
        return [with_signs(log_set, defect.joints)]
    return []


def derived(t: Trajectory, columns: list[int]) -> Trajectory:
    """The trial with the velocities of some joints (indices) taken from their positions."""
    velocity = t.velocity.copy()
    velocity[:, columns] = differentiate(t.position[:, columns], t.dt)
    return replace(t, velocity=velocity)


def joined_up(values: np.ndarray) -> np.ndarray:
    """(T,) or (T, J) with straight lines between the samples that changed."""
    if values.ndim > 1:
        return np.stack([joined_up(column) for column in values.T], axis=1)
    fresh = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    return np.interp(np.arange(len(values)), fresh, values[fresh])


def _columns(defect: Defect, log_set: LogSet, file: str) -> list[int]:
    cells = defect.where_in()
    return [log_set.joints.index(joint) for joint in defect.joints if (file, joint) in cells]


def _mended(log_set: LogSet, defect: Defect, mend: Mend) -> LogSet:
    trials = tuple(
        replace(trial, trajectory=mend(trial.trajectory, trial.file)) if trial.file in defect.trials else trial
        for trial in log_set.trials
    )
    return replace(log_set, trials=trials)


def _with_derived(t: Trajectory, names: tuple[str | None, ...], columns: list[int]) -> Trajectory:
    """A velocity that comes from the positions follows them."""
    follows = t.velocity_source != "measured" and "position" in names
    return derived(t, columns) if follows else t


def _reordered(t: Trajectory, order: np.ndarray) -> Trajectory:
    back = replace(t, **{name: values[order] for name, values in t.channels().items()})
    return _with_derived(back, ("position",), list(range(len(t.joints))))


def _moved(t: Trajectory, names: tuple[str | None, ...], to: list[int], source: list[int]) -> Trajectory:
    found = {}
    for name in names:
        found[name] = getattr(t, name).copy()
        found[name][:, to] = getattr(t, name)[:, source]
    return _with_derived(replace(t, **found), names, to)


def _changed(
    t: Trajectory, names: tuple[str | None, ...], columns: list[int], change: Callable[[np.ndarray], np.ndarray]
) -> Trajectory:
    found = {}
    for name in (name for name in names if getattr(t, name) is not None):
        found[name] = getattr(t, name).copy()
        found[name][:, columns] = change(found[name][:, columns])
    return _with_derived(replace(t, **found), names, columns)
