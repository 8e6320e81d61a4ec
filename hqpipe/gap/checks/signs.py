"""Logs whose torque lost its sign, with the sign restored before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.gap.checks.unsigned import Unsigned, never_negative, restore_sign, unsigned
from hqpipe.logs.trajectory import LogSet, Trajectory

NAME = "unsigned_sensor"
RATE_APART = 0.1  # of the logarithm: rates that differ by less are one


@dataclass(frozen=True, eq=False)
class SignedLogs:
    """A log set fit to be diagnosed, and the joints whose effort had lost its sign.

    Attributes:
        log_set: with signed efforts. raw: as it came.
        findings: joints whose own log proves it.
        alike: joints whose effort is never negative either, on a machine where that is proven of others.
    """

    log_set: LogSet
    raw: LogSet
    findings: tuple[Unsigned, ...] = ()
    alike: tuple[str, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """In the order of the log."""
        found = {*(entry.joint for entry in self.findings), *self.alike}
        return tuple(joint for joint in self.log_set.joints if joint in found)


def restore_efforts(log_set: LogSet, without: Sequence[str] = ()) -> SignedLogs:
    """Give unsigned efforts their sign back, in position mode.

    Args:
        log_set: any.
        without: effects left out of the library; the restoration is one of them.
    """
    if log_set.control_mode != "position" or NAME in without:
        return SignedLogs(log_set, log_set)
    found = tuple(entry for entry in unsigned(log_set.trials) if entry.channel == "effort")
    if not found:
        return SignedLogs(log_set, log_set)
    proven = {entry.joint for entry in found}
    alike = tuple(joint for joint in never_negative(log_set.trials, "effort") if joint not in proven)
    return SignedLogs(with_signs(log_set, (*proven, *alike)), log_set, found, alike)


def with_signs(log_set: LogSet, joints: Iterable[str]) -> LogSet:
    """The log set with the efforts of some joints signed, in position mode, whether they had lost their sign or not."""
    trials = [trial.trajectory for trial in log_set.trials]
    efforts = [t.effort.copy() for t in trials]
    for j in (log_set.joints.index(joint) for joint in joints):
        for effort, values in zip(efforts, restored(trials, j), strict=True):
            effort[:, j] = values
    mended = tuple(
        replace(trial, trajectory=replace(trial.trajectory, effort=effort))
        for trial, effort in zip(log_set.trials, efforts, strict=True)
    )
    return replace(log_set, trials=mended)


def restored(trials: Sequence[Trajectory], j: int) -> list[np.ndarray]:
    """Per trial the effort (T,) of a joint with its sign; trials of one rate together, for the model is one of a step."""
    found: dict[int, np.ndarray] = {}
    rates = np.round(np.log([t.dt for t in trials]) / RATE_APART)
    for rate in np.unique(rates):
        alike = np.flatnonzero(rates == rate)
        part = [trials[i] for i in alike]
        names = ("effort", "position_command", "position", "velocity")
        signals = ([getattr(t, name)[:, j] for t in part] for name in names)
        found |= dict(zip(alike.tolist(), restore_sign(*signals, part[0].dt), strict=True))
    return [found[i] for i in range(len(trials))]
