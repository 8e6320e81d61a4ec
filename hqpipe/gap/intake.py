"""Whether a log set can be diagnosed at all: its channels, its signs, its defects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.gap.confirm import confirmed
from hqpipe.gap.defect import Defect
from hqpipe.gap.joint_data import COMMAND_CHANNEL
from hqpipe.gap.sanity import check_logs
from hqpipe.gap.sensing import channel_warnings
from hqpipe.gap.signs import SignedLogs, restore_efforts
from hqpipe.logs.columns import joint_column
from hqpipe.logs.trajectory import LogSet
from hqpipe.sysid.free_run import window_samples
from hqpipe.sysid.window_choice import WindowChoice, window_for

LONGER = "record longer trials in which every joint moves, one of them held out"
NOT_USED = ("velocity_mismatch",)  # defects of the velocity channel: the models run on the change of position


@dataclass(frozen=True, eq=False)
class Intake:
    """A log set that has been looked through.

    Attributes:
        log_set: with signed efforts, and without trials that hold no window. signed: the same, and what it was before.
        window: of the free run. steps: its samples. warnings: what to know.
        reasons: why nothing can be said of it, the gravest first; empty for a sound one. advice: the mend then.
    """

    log_set: LogSet
    signed: SignedLogs
    window: WindowChoice
    steps: int
    warnings: tuple[str, ...]
    reasons: tuple[str, ...] = ()
    advice: str | None = None


def take_in(log_set: LogSet, window_s: float | None, without: Sequence[str] = ()) -> Intake:
    """Look a log set through before a model is fitted to it.

    Args:
        log_set: any. window_s: s, or None for what suits the logs. without: effects left out of the library.

    Raises:
        IdentificationError: no layer can be evaluated.
    """
    mode = log_set.control_mode
    trials = [trial.trajectory for trial in log_set.trials]
    if trials[0].effort is None and mode != "valve":
        raise IdentificationError(
            f"{log_set.path}: no layer can be evaluated without '{joint_column('<name>', 'effort')}'; "
            "record the joint torque (for the actuator layer with the command of its control mode)"
        )
    warnings = (*log_set.warnings, *channel_warnings(trials))
    dt = float(np.median([t.dt for t in trials]))
    lacking = [COMMAND_CHANNEL[mode]] if mode and getattr(trials[0], COMMAND_CHANNEL[mode]) is None else []
    if mode is None or lacking:
        column = joint_column("<name>", lacking[0] if lacking else "position_command")
        reason = f"the actuator layer needs {column}: only the sensing layer was evaluated"
        signed, window = SignedLogs(log_set, log_set), window_for(log_set, window_s)
        steps = window_samples(dt, window.seconds, log_set.path)
        return Intake(log_set, signed, window, steps, (*warnings, reason), (reason,), "record the missing channel")
    signed = restore_efforts(log_set, without)
    log_set = signed.log_set
    window = window_for(log_set, window_s)
    steps = window_samples(dt, window.seconds, log_set.path)
    defects = check_logs(log_set, window_s=window.seconds)
    fatal = tuple(d.message for d in defects if _stops(d) and confirmed(d, log_set, steps))
    warnings += tuple(d.message for d in defects if not _stops(d))
    if fatal:
        short = any(d.kind == "too_short" for d in defects)
        advice = LONGER if short else "mend the logs, then diagnose them again"
        return Intake(log_set, signed, window, steps, (*fatal, *warnings), fatal, advice)
    short = [t.file for t in log_set.trials if t.trajectory.samples <= steps]
    log_set = replace(log_set, trials=tuple(t for t in log_set.trials if t.file not in short))
    warnings += tuple(f"{name}: shorter than one window, left out" for name in short)
    if not log_set.fit or not log_set.heldout:
        reason = "no fit or no held-out trial holds a window"
        return Intake(log_set, signed, window, steps, (*warnings, reason), (reason,), LONGER)
    return Intake(log_set, signed, window, steps, warnings)


def _stops(defect: Defect) -> bool:
    """Whether nothing can be said of logs with this defect, if it is confirmed."""
    return defect.fatal and defect.kind not in NOT_USED
