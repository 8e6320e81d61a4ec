"""What of a log set can be diagnosed: its channels and signs are looked through, and what is broken is left out.

A check names a defect, a comparison of models says whether the answer would be another without it (`confirmed`), and the
channel, the joint or the trial that has it is left out (`leave_out`). What is left is looked through again, since a defect
can show in trials and joints that do not have it. The diagnosis ends only where no joint, no fit or no held-out trial is left.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hqpipe.errors import IdentificationError
from hqpipe.gap.checks.confirm import confirmed
from hqpipe.gap.checks.defect import Defect
from hqpipe.gap.checks.left_out import LeftOut, leave_out, of_joints, without_trials
from hqpipe.gap.checks.repair import repairs
from hqpipe.gap.checks.sanity import check_logs
from hqpipe.gap.checks.sanity_order import order_defects
from hqpipe.gap.checks.sensing import channel_warnings
from hqpipe.gap.checks.signs import SignedLogs, restore_efforts
from hqpipe.identify.free_run import window_samples
from hqpipe.identify.window_choice import MIN_WINDOWS, WindowChoice, window_for
from hqpipe.logs.columns import COMMAND_CHANNEL, joint_column
from hqpipe.logs.end_stops import Travel, judged_windows, mark_end_stops
from hqpipe.logs.findings import in_trials
from hqpipe.logs.trajectory import LogSet

LONGER = "record longer trials in which every joint moves, one of them held out"
MEND = "correct the logs, then diagnose them again"
RESTING, AWAY = "end_stop", "record longer motion between the end stops"
SEEN = ("constant", "saturated", "held_samples", "velocity_mismatch")  # facts, also where the models do not mind them


@dataclass(frozen=True, eq=False)
class Intake:
    """A log set that has been looked through.

    Attributes:
        log_set: with signed efforts, without what is left out. signed: the same, and what it was before.
        window: of the free run. steps: its samples. warnings: what to know.
        reasons: why nothing can be said of it, the gravest first; empty where something can. advice: what to do then.
        left_out: parts of the logs that had to go.
        spare: joint that was left out → logs in which it is sound, mended or of its other trials; None where there are none.
        stops: what the law from command to torque is not judged on, at end stops.
    """

    log_set: LogSet
    signed: SignedLogs
    window: WindowChoice
    steps: int
    warnings: tuple[str, ...]
    reasons: tuple[str, ...] = ()
    advice: str | None = None
    left_out: tuple[LeftOut, ...] = ()
    spare: dict[str, LogSet | None] = field(default_factory=dict)
    stops: tuple[str, ...] = ()


def take_in(
    log_set: LogSet, window_s: float | None, without: Sequence[str] = (), travel: Travel | None = None
) -> Intake:
    """Look a log set through before a model is fitted to it.

    Args:
        log_set: whose law from command to torque is asked for, see `hqpipe.gap.routing`.
        window_s: s, or None for what suits the logs. without: effects left out of the library.
        travel: stated limits of the joints' positions, where end stops may be.

    Raises:
        IdentificationError: no layer can be evaluated.
    """
    mode = log_set.control_mode
    trials = [trial.trajectory for trial in log_set.trials]
    if trials[0].effort is None:
        raise IdentificationError(
            f"{log_set.path}: no layer can be evaluated without '{joint_column('<name>', 'effort')}'; "
            "record the joint torque (for the actuator layer with the command of its control mode)"
        )
    dt = float(np.median([t.dt for t in trials]))
    lacking = [COMMAND_CHANNEL[mode]] if mode and getattr(trials[0], COMMAND_CHANNEL[mode]) is None else []
    if mode is None or lacking:
        column = joint_column("<name>", lacking[0] if lacking else "position_command")
        reason = f"the actuator layer needs {column}: only the sensing layer was evaluated"
        warnings = (*log_set.warnings, *channel_warnings(trials), reason)
        window = window_for(log_set, window_s)
        steps = window_samples(dt, window.seconds, log_set.path)
        signed = SignedLogs(log_set, log_set)
        return Intake(log_set, signed, window, steps, warnings, (reason,), "record the missing channel")
    marked, stops = mark_end_stops(log_set, travel)
    return replace(_sifted(marked, window_s, dt, without), stops=stops)


def _sifted(log_set: LogSet, window_s: float | None, dt: float, without: Sequence[str]) -> Intake:
    """The log set without what is broken in it; the window is chosen with the signs restored and before anything goes."""
    apart, names = _named_apart(log_set)
    signed = restore_efforts(apart, without)
    window = window_for(signed.log_set, window_s)
    sieve = _Sieve(apart, names, window, window_samples(dt, window.seconds, log_set.path))
    if sieve.drop_short() | sieve.drop_resting():
        signed = restore_efforts(sieve.logs, without)
    while not sieve.empty:
        defects = _as_recorded(check_logs(signed.log_set, window_s=window.seconds), sieve.logs, signed)
        if not sieve.take(defects, signed):
            short = tuple(d.message for d in defects if d.kind == "too_short")
            told = tuple(d.message for d in defects if d.kind in SEEN or not d.fatal)
            return sieve.intake(signed, told, short, LONGER if short else None)
        signed = restore_efforts(sieve.logs, without)
    kinds = {item.kind for item in sieve.left}
    advice = AWAY if kinds == {RESTING} else LONGER if kinds <= {"too_short", RESTING} else MEND
    return sieve.intake(signed, (), tuple(f"{item.reason}; {item.fix}" for item in sieve.left), advice)


def _as_recorded(defects: list[Defect], raw: LogSet, signed: SignedLogs) -> list[Defect]:
    """What was found in logs with restored signs, as far as it is a defect of the logs as they came.

    A restored sign comes from the command of its row, so that it makes an order of any, and can itself be wrong.
    """
    if not signed.joints:
        return defects
    hidden = [d for d in order_defects(raw) if d.kind == "rows_out_of_order" and d.channel == "effort"]
    found = []
    for defect in defects:
        if (defect.kind, defect.channel) == ("sign_flipped", "effort"):
            defect = defect.for_joints([joint for joint in defect.joints if joint not in signed.joints])
        if defect.joints or not defect.what:
            found.append(defect)
    return [*hidden, *found]


def _named_apart(log_set: LogSet) -> tuple[LogSet, dict[str, str]]:
    """The log set with a name of its own for each part of a trial that is both fitted and held out, and what it was."""
    count = Counter(trial.file for trial in log_set.trials)
    names, trials = {}, []
    for trial in log_set.trials:
        part = "held-out" if trial.split == "heldout" else "fit"
        name = f"{trial.file} ({part} part)" if count[trial.file] > 1 else trial.file
        names[name] = trial.file
        trials.append(replace(trial, file=name))
    return replace(log_set, trials=tuple(trials)), names


def _named_back(log_set: LogSet, names: dict[str, str]) -> LogSet:
    return replace(log_set, trials=tuple(replace(trial, file=names[trial.file]) for trial in log_set.trials))


class _Sieve:
    """A log set from which parts are taken until it is sound.

    Attributes:
        logs: what is left of it, as it came. names: name of each of its trials → that of its file.
        empty: whether nothing is left; `logs` is then what there was before.
        left: what was left out. spare: see `Intake`.
    """

    def __init__(self, logs: LogSet, names: dict[str, str], window: WindowChoice, steps: int) -> None:
        self.logs, self.names, self.window, self.steps = logs, names, window, steps
        self.left: list[LeftOut] = []
        self.spare: dict[str, LogSet | None] = {}
        self.empty = False
        self._judged: set[tuple[object, ...]] = set()

    def drop_short(self) -> bool:
        """Leave out trials that hold no window; whether there were any."""
        if short := [t.file for t in self.logs.trials if t.trajectory.samples <= self.steps]:
            where = in_trials(short, self.logs.trials)
            reason = f"{where}: shorter than one window of {self.steps} samples"
            self.left.append(LeftOut(tuple(short), (), None, "too_short", reason, "record longer trials"))
            self._keep(without_trials(self.logs, short))
        return bool(short)

    def drop_resting(self) -> bool:
        """Leave out joints that are at their end stops in nearly all windows; whether there were any."""
        logs = self.logs
        found = [joint for j, joint in enumerate(logs.joints) if self._windows_left(j) < MIN_WINDOWS]
        for joint in found if not self.empty else ():
            reason = (
                f"{joint}: at an end stop in all but {self._windows_left(logs.joints.index(joint))} windows of a split"
            )
            self.left.append(LeftOut(tuple(t.file for t in logs.trials), (joint,), None, RESTING, reason, AWAY))
            self.spare[joint] = None
        if found and not self.empty:
            self._keep(of_joints(logs, [joint for joint in logs.joints if joint not in found]))
        return bool(found)

    def _windows_left(self, j: int) -> float:
        """In the split that has fewer of them, the windows in which a joint that has end stops touches none."""
        left, touched = [], False
        for trials in filter(None, (self.logs.fit, self.logs.heldout)):
            left.append(0)
            for t in (trial.trajectory for trial in trials):
                judged = judged_windows(t, self.steps)
                touched |= judged is not None and not judged[:, j].all()
                left[-1] += (t.samples - 1) // self.steps if judged is None else int(judged[:, j].sum())
        return min(left) if touched else np.inf  # of any other joint what is too short is asked elsewhere

    def take(self, defects: Sequence[Defect], signed: SignedLogs) -> bool:
        """Leave out what the gravest kind of defect costs; whether there was any.

        Args:
            defects: of the logs with signed efforts.
        """
        for kind in dict.fromkeys(d.kind for d in defects if d.fatal and d.kind != "too_short"):
            judged = (self.logs, signed.joints) if kind == "rows_out_of_order" else (signed.log_set, ())
            real = [part for d in defects if d.kind == kind and d.fatal for part in self._proven(d, *judged)]
            if any([self._leave(defect, signed.log_set) for defect in real]):
                return True
        return False

    def intake(self, signed: SignedLogs, told: Sequence[str], reasons: tuple[str, ...], advice: str | None) -> Intake:
        logs, raw = (_named_back(part, self.names) for part in (signed.log_set, signed.raw))
        signed = replace(signed, log_set=logs, raw=raw)
        channels = channel_warnings([trial.trajectory for trial in logs.trials])
        warnings = (*reasons, *logs.warnings, *channels, *told)
        return Intake(logs, signed, self.window, self.steps, warnings, reasons, advice, tuple(self.left), self.spare)

    def _proven(self, defect: Defect, logs: LogSet, signless: Sequence[str]) -> list[Defect]:
        """The part of a defect that would change the answer and has not been judged before, joint by joint."""
        real = []
        for part in [defect.for_joints([joint]) for joint in defect.joints] if defect.what else [defect]:
            key = part.kind, part.channel, part.joints, part.trials
            if key not in self._judged and confirmed(part, logs, self.steps, signless):
                real.append(part)
            self._judged.add(key)
        if real and defect.what:
            return [defect.for_joints([joint for part in real for joint in part.joints])]
        return real

    def _leave(self, defect: Defect, signed: LogSet) -> bool:
        """Leave out what a defect costs, as far as it is still there; whether anything was."""
        here = defect.within(self.logs.joints, {trial.file for trial in self.logs.trials})
        if self.empty or not here.trials or bool(defect.joints) != bool(here.joints):
            return False
        if not set(here.joints) <= set(self.logs.joints):  # a swap one of whose joints is gone: the next round sees
            return False
        rest, items = leave_out(here, self.logs)
        known = {(joint, item.channel) for item in self.left if item.channel for joint in item.joints}
        new = [item for item in items if not (item.channel and {(j, item.channel) for j in item.joints} <= known)]
        for joint in {joint for item in new if item.channel is None for joint in item.joints}:
            self.spare[joint] = _spare(defect, signed, joint)
        self.left += new
        self._keep(rest)
        return bool(new)

    def _keep(self, rest: LogSet | None) -> None:
        self.empty = rest is None
        self.logs = rest or self.logs


def _spare(defect: Defect, log_set: LogSet, joint: str) -> LogSet | None:
    """Logs in which a joint that is left out for a defect is sound."""
    mended = repairs(defect, log_set)
    if len(mended) == 1:  # a ring of three may have turned either way
        return of_joints(mended[0], [joint])
    rest = without_trials(log_set, {file for file, name in defect.where_in() if name == joint})
    return of_joints(rest, [joint]) if rest is not None else None
