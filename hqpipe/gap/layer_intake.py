"""What is looked through before a layer is asked other than the law from command to torque, as far as its channels allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hqpipe.gap.checks.left_out import LeftOut, without_trials
from hqpipe.gap.checks.sanity_order import order_defects
from hqpipe.gap.checks.sensing import channel_warnings
from hqpipe.gap.intake import take_in
from hqpipe.gap.routing import JOINT_MOTION, TORQUE, has_law
from hqpipe.logs.end_stops import Travel, mark_end_stops
from hqpipe.logs.trajectory import LogSet


@dataclass(frozen=True, eq=False)
class LayerIntake:
    """A log set that was looked through for a layer.

    Attributes:
        log_set: without what had to go. left_out: that. warnings: what to know. reasons: why nothing can be said of it; empty
            where something can. advice: what to do then.
    """

    log_set: LogSet
    left_out: tuple[LeftOut, ...]
    warnings: tuple[str, ...]
    reasons: tuple[str, ...] = ()
    advice: str | None = None


def layer_intake(name: str, log_set: LogSet, without: Sequence[str] = (), travel: Travel | None = None) -> LayerIntake:
    """Look a log set through for a layer that is asked alone.

    Args:
        name: of `hqpipe.layers`. without: effects left out of the library. travel: stated limits of the joints' positions.

    Raises:
        IdentificationError: no layer can be evaluated.
    """
    if name == JOINT_MOTION and has_law(log_set):
        intake = take_in(log_set, None, without)
        logs = intake.log_set if intake.reasons else intake.signed.raw
        return LayerIntake(logs, intake.left_out, intake.warnings, intake.reasons, intake.advice)
    logs, left_out, warnings = position_checks(log_set)
    if name == TORQUE:
        logs, stops = mark_end_stops(logs, travel)
        warnings = [*warnings, *stops]
    return LayerIntake(logs, tuple(left_out), tuple(warnings))


def position_checks(log_set: LogSet) -> tuple[LogSet, list[LeftOut], list[str]]:
    """The log set without trials whose rows are out of order, what these are, and what to know of the channels.

    Nothing is refused here: where no fit or no held-out trial would be left, a defect is a warning.
    """
    left, warnings = [], []
    for defect in order_defects(log_set):
        if (defect.kind, defect.channel) != ("rows_out_of_order", None):
            continue
        rest = without_trials(log_set, defect.trials)
        if rest is None:
            warnings.append(defect.message)
        else:
            log_set = rest
            left.append(LeftOut(defect.trials, (), None, defect.kind, defect.reason, defect.fix))
    channels = channel_warnings([trial.trajectory for trial in log_set.trials])
    return log_set, left, [*warnings, *log_set.warnings, *channels]
