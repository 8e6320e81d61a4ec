"""What is looked through before a layer is asked that needs no torque: rows of trials, channels against each other."""

from __future__ import annotations

from hqpipe.gap.checks.left_out import LeftOut, without_trials
from hqpipe.gap.checks.sanity_order import order_defects
from hqpipe.gap.checks.sensing import channel_warnings
from hqpipe.logs.trajectory import LogSet


def position_checks(log_set: LogSet) -> tuple[LogSet, list[LeftOut], list[str]]:
    """The log set without trials whose rows are out of order, what these are, and what to know of the channels.

    Nothing is refused here: where no fit or no held-out trial would be left, a defect is a warning.
    """
    left, told = [], []
    for defect in order_defects(log_set):
        if (defect.kind, defect.channel) != ("rows_out_of_order", None):
            continue
        rest = without_trials(log_set, defect.trials)
        if rest is None:
            told.append(defect.message)
        else:
            log_set = rest
            left.append(LeftOut(defect.trials, (), None, defect.kind, defect.reason, defect.fix))
    channels = channel_warnings([trial.trajectory for trial in log_set.trials])
    return log_set, left, [*told, *log_set.warnings, *channels]
