"""What a defect costs: the channel, the joint or the trial that has it, and never more of the logs than that."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from hqpipe.gap.checks.confirm import used
from hqpipe.gap.checks.defect import Defect
from hqpipe.gap.checks.repair import derived
from hqpipe.logs.trajectory import LogSet, Trial

MOST = 0.5  # share of a joint's logged time with a defect beyond which the defect is the joint's
PRESSURES = ("pressure_a", "pressure_b")


@dataclass(frozen=True)
class LeftOut:
    """A part of the logs that an answer does without.

    Attributes:
        trials: files. With `joints` empty they are left out whole; else the defect was found in them.
        joints: left out in every trial; with a `channel`, only that channel of them is, in these trials.
        channel: in the log format, or None.
        kind: of the defect, one of `hqpipe.gap.checks.defect.KINDS`, or "end_stop". reason: one line. fix: what to do about it.
    """

    trials: tuple[str, ...]
    joints: tuple[str, ...]
    channel: str | None
    kind: str
    reason: str
    fix: str

    def content(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        return {key: list(v) if isinstance(v, tuple) else v for key, v in asdict(self).items()}


def leave_out(defect: Defect, log_set: LogSet) -> tuple[LogSet | None, list[LeftOut]]:
    """The log set without what has a defect, and what that is; None where no joint or no trial would be left.

    A channel that the models of the control mode do not read is blanked, a velocity is taken from the positions instead.
    Any other defect of single joints costs the joint where it is in most of the joint's trials; elsewhere the joint or the
    trial, whichever holds fewer seconds of joints, but a trial only if fit and held-out trials are left without it.
    """
    if defect.channel == "velocity" or not used(defect, log_set):
        channels = defect.channels or (defect.channel,)
        blank = _without_channels(defect, log_set, channels)
        return blank, [_entry(defect, defect.trials, defect.joints, channel) for channel in channels]
    if not defect.joints:
        return without_trials(log_set, defect.trials), [_entry(defect, defect.trials, ())]
    joints, trials = _cheapest(defect, log_set)
    found = []
    if joints:
        found.append(_entry(defect, _files_of(defect, joints), joints))
    if trials:
        found.append(_entry(defect, trials, ()))
    rest = without_trials(log_set, trials) if trials else log_set
    return (without_joints(rest, joints) if rest is not None else None), found


def without_trials(log_set: LogSet, files: Collection[str]) -> LogSet | None:
    """The log set without some trials; None where no fit or no held-out trial is left."""
    rest = replace(log_set, trials=tuple(trial for trial in log_set.trials if trial.file not in files))
    return rest if rest.fit and rest.heldout else None


def without_joints(log_set: LogSet, joints: Collection[str]) -> LogSet | None:
    """The log set without some joints; None where none is left."""
    return of_joints(log_set, [joint for joint in log_set.joints if joint not in joints])


def of_joints(log_set: LogSet, joints: Sequence[str]) -> LogSet | None:
    """The log set with these joints only, in this order; None for none."""
    if not joints:
        return None
    if tuple(joints) == log_set.joints:
        return log_set
    trials = tuple(replace(trial, trajectory=trial.trajectory.for_joints(joints)) for trial in log_set.trials)
    return replace(log_set, joints=tuple(joints), trials=trials)


def _entry(defect: Defect, trials: Sequence[str], joints: Sequence[str], channel: str | None = None) -> LeftOut:
    return LeftOut(tuple(trials), tuple(joints), channel, defect.kind, defect.reason, defect.fix)


def _files_of(defect: Defect, joints: Sequence[str]) -> tuple[str, ...]:
    cells = defect.where_in()
    return tuple(file for file in defect.trials if any((file, joint) in cells for joint in joints))


def _without_channels(defect: Defect, log_set: LogSet, channels: Sequence[str | None]) -> LogSet:
    """The channels of the defect's joints as if they had not been recorded; one pressure says nothing without the other."""
    if any(name in PRESSURES for name in channels):
        channels = [*channels, *PRESSURES]
    cells = defect.where_in()

    def change(trial: Trial) -> Trial:
        columns = [log_set.joints.index(joint) for joint in defect.joints if (trial.file, joint) in cells]
        t = derived(trial.trajectory, columns) if "velocity" in channels and columns else trial.trajectory
        blank = {}
        for name in channels if columns else ():
            if name != "velocity" and getattr(t, name) is not None:
                blank[name] = getattr(t, name).copy()
                blank[name][:, columns] = 0.0
        return replace(trial, trajectory=replace(t, **blank))

    return replace(log_set, trials=tuple(change(trial) for trial in log_set.trials))


def _cheapest(defect: Defect, log_set: LogSet) -> tuple[list[str], list[str]]:
    """Joints and trials that hold every (trial, joint) of a defect, of as few seconds as can be."""
    seconds = {trial.file: trial.trajectory.duration for trial in log_set.trials}
    cells = set(defect.where_in())
    bound = defect.kind == "swapped"  # all of its joints have it, or none
    joints: list[str] = []
    for joint in defect.joints:
        share = sum(seconds[file] for file, name in cells if name == joint) / max(sum(seconds.values()), 1e-300)
        if share > MOST:
            joints.append(joint)
    if bound and joints:
        joints = list(defect.joints)
    trials: list[str] = []
    for file in defect.trials:
        here = [name for f, name in cells if f == file and name not in joints]
        if not here:
            continue
        of_trial = seconds[file] * (len(log_set.joints) - len(joints))
        of_joints_ = sum(s for f, s in seconds.items() if f not in trials) * len(here)
        if of_trial <= of_joints_ and without_trials(log_set, [*trials, file]) is not None:
            trials.append(file)
        else:
            joints += here
    # A trial is not given up for a joint that is left out anyway.
    trials = [file for file in trials if any(f == file and name not in joints for f, name in cells)]
    return [joint for joint in defect.joints if joint in joints], trials
