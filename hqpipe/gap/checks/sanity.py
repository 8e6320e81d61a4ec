"""Is the log itself sound? Checked before a cause is sought: a broken log imitates most effects.

Nothing here models the machine. The tests rest on what holds for any joint: sampled motion is smooth, a velocity is
a derivative, a torque follows its joint's own inputs, a closed loop pulls towards its command. Each trial is
judged by itself, so that a defect of one trial is found too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hqpipe.gap.checks.defect import KINDS, Defect, listed
from hqpipe.gap.checks.sanity_order import order_defects
from hqpipe.gap.checks.sanity_units import unit_defects
from hqpipe.gap.checks.sanity_values import value_defects
from hqpipe.gap.checks.sanity_wiring import wiring_defects
from hqpipe.gap.checks.unsigned import Unsigned, never_negative, unsigned
from hqpipe.logs.columns import joint_column
from hqpipe.logs.trajectory import LogSet

__all__ = ["KINDS", "Defect", "check_logs", "too_short"]

MIN_WINDOWS = 20  # of each split; assumption: with fewer, an error has no usable uncertainty
WINDOW_S = 0.1  # as hqpipe.identify.free_run


def check_logs(log_set: LogSet, *, window_s: float = WINDOW_S) -> list[Defect]:
    """Everything that is broken in a log set, the worst first; empty for a sound one.

    Args:
        log_set: trials of one machine.
        window_s: length of the windows in which models will be compared, s.
    """
    ordered = order_defects(log_set)
    broken = {(d.channel, file) for d in ordered if d.kind == "rows_out_of_order" for file in d.trials}
    whole = {file for channel, file in broken if channel is None}
    broken |= {(name, file) for file in whole for name in log_set.trials[0].trajectory.channels()}
    judged = replace(log_set, trials=tuple(t for t in log_set.trials if not any(f == t.file for _, f in broken)))
    sizes = unsigned(judged.trials)
    wiring = wiring_defects(judged, set(never_negative(judged.trials, "effort")))
    explained = {
        (j, file) for d in (*ordered, *wiring) if d.kind != "sign_flipped" for j in d.joints for file in d.trials
    }
    explained |= {(entry.joint, file) for entry in sizes if entry.channel == "velocity" for file in entry.trials}
    values = [d for d in value_defects(log_set, broken) if not _follows(d, explained)]
    found = [*too_short(log_set, window_s), *ordered, *unit_defects(judged), *wiring, *values, *_sizes(log_set, sizes)]
    return sorted(found, key=lambda defect: (not defect.fatal, KINDS.index(defect.kind)))


def _follows(defect: Defect, explained: set[tuple[str, str]]) -> bool:
    """Whether a wrong velocity is only the consequence of another defect of the same joints and trials."""
    pairs = {(joint, file) for joint in defect.joints for file in defect.trials}
    return defect.kind == "velocity_mismatch" and pairs <= explained


def _sizes(log_set: LogSet, sizes: list[Unsigned]) -> list[Defect]:
    found = []
    for channel in dict.fromkeys(entry.channel for entry in sizes):
        entries = [entry for entry in sizes if entry.channel == channel]
        proven = [entry.joint for entry in entries]
        alike = [j for j in never_negative(log_set.trials, channel) if j not in proven]
        text = (
            f"{joint_column(proven[0], channel)}"
            + (f" (and of {listed(proven[1:])})" if len(proven) > 1 else "")
            + f" has lost its sign: it is never negative, and {_proof(entries)}"
            + (f"; that of {listed(alike)} is never negative either" if alike else "")
            + "; record the signed signal"
        )
        found.append(Defect("unsigned", entries[0].trials, (*proven, *alike), channel, text, fatal=True))
    return found


def _proof(entries: Sequence[Unsigned]) -> str:
    """By what the signs of one channel are known to be lost."""
    ratios = [entry.error_ratio for entry in entries if not entry.pulls_away]
    away = [entry.joint for entry in entries if entry.pulls_away]
    pulls = "as it was logged it pulls away from its command"
    if not ratios:
        return pulls
    explained = f"with its sign restored its own inputs explain it with at most {max(ratios):.0%} of the squared error"
    return f"{explained} ({listed(away)}: {pulls})" if away else explained


def too_short(log_set: LogSet, window_s: float = WINDOW_S) -> list[Defect]:
    """Splits that hold too few windows, with what is missing."""
    found = []
    for split, trials in (("fit", log_set.fit), ("heldout", log_set.heldout)):
        windows = sum(int((t.trajectory.duration + 1e-9) / window_s) for t in trials)
        if windows >= MIN_WINDOWS:
            continue
        seconds = sum(t.trajectory.duration for t in trials)
        name = "held-out" if split == "heldout" else "fit"
        text = (
            f"{len(trials)} {name} trials last {seconds:.3g} s: {windows} windows of {window_s:g} s, expected at least "
            f"{MIN_WINDOWS}; record at least {MIN_WINDOWS * window_s - windows * window_s:.3g} s more"
        )
        found.append(Defect("too_short", tuple(t.file for t in trials), (), None, text, fatal=True))
    return found
