"""Earlier logs of a machine with commanded positions, as new ones are compared with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hqpipe.errors import IdentificationError
from hqpipe.gap.answer.second_channel import measured
from hqpipe.gap.change.since import EarlierLogs
from hqpipe.gap.intake import Intake, take_in
from hqpipe.identify.model import LayerJoints
from hqpipe.layers.actuator import Actuator
from hqpipe.logs.end_stops import Travel


@dataclass(frozen=True, eq=False)
class PositionRecord:
    """Earlier logs that were looked through.

    Attributes:
        logs: as they came. intake: of them. joints: that can be judged. measured: (effect, joint) that a comparison with the
            pressures shows there.
    """

    logs: EarlierLogs
    intake: Intake
    joints: LayerJoints
    measured: frozenset[tuple[str, str]]

    @property
    def warnings(self) -> list[str]:
        told = (*self.intake.warnings, *self.intake.stops, *(item.reason for item in self.intake.left_out))
        return [f"reference: {text}" for text in told]


def position_record(
    logs: EarlierLogs, window_s: float | None, without: Sequence[str] = (), travel: Travel | None = None
) -> PositionRecord:
    """Look earlier logs through.

    Args:
        window_s: s, or None for what suits the logs. without: effects left out of the library.
        travel: stated limits of the joints' positions, where end stops may be.

    Raises:
        IdentificationError: they cannot be diagnosed.
    """
    intake = take_in(logs.log_set, window_s, without, travel)
    if intake.reasons:
        raise _refused(logs, intake.reasons[0], intake.advice)
    try:
        joints = Actuator(unsigned=intake.signed.joints).joints(intake.log_set, intake.window.seconds, without)
    except IdentificationError as error:
        raise _refused(logs, error.message, error.fix) from error
    found = frozenset((check.effect, check.joint) for check in measured(intake.log_set, without))
    return PositionRecord(logs, intake, joints, found)


def _refused(logs: EarlierLogs, reason: str, fix: str | None) -> IdentificationError:
    path = logs.log_set.path
    return IdentificationError(f"reference {path}: {reason}", file=path, fix=fix or "give other logs")
