"""Logs whose torque lost its sign, with the sign restored before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hqpipe.gap.unsigned import Unsigned, never_negative, restore_sign, unsigned
from hqpipe.logs.trajectory import LogSet

NAME = "unsigned_sensor"


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
    trials = [trial.trajectory for trial in log_set.trials]
    efforts = [t.effort.copy() for t in trials]
    for joint in (*proven, *alike):
        j = log_set.joints.index(joint)
        signed = restore_sign(
            [t.effort[:, j] for t in trials],
            [t.position_command[:, j] for t in trials],
            [t.position[:, j] for t in trials],
            [t.velocity[:, j] for t in trials],
            trials[0].dt,
        )
        for effort, values in zip(efforts, signed, strict=True):
            effort[:, j] = values
    mended = tuple(
        replace(trial, trajectory=replace(trial.trajectory, effort=effort))
        for trial, effort in zip(log_set.trials, efforts, strict=True)
    )
    return SignedLogs(replace(log_set, trials=mended), log_set, found, alike)
